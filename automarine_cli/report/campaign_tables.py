"""What `run` shows of a campaign: a row a step, and cautions that only the whole campaign gives."""

from collections.abc import Mapping, Sequence

from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.results.models import ThrusterFile, VoltagePower


def steps_table(rows: Sequence[tuple[str, str, str, str]]) -> Table:
    """Step, what was done, why, and what its result says."""
    cells = tuple(
        (name, did if did != "made" else "done", why or MISSING, says or MISSING) for name, did, why, says in rows
    )
    return Table("", ("step", "", "because", "result"), cells)


ALIKE = 1.03  # voltages that differ by less are one, as in the thruster fit
SAID = ("fit-yaw", "validate", "diagnose")


def campaigns_table(rows: Sequence[tuple[str, Mapping[str, str], Sequence[str]]]) -> Table:
    """Of several campaigns: name, what the steps that matter most say, and what was refused."""
    cells = tuple(
        (name, *(says.get(step, "") or MISSING for step in SAID), "; ".join(refused) or MISSING)
        for name, says, refused in rows
    )
    return Table("", ("campaign", *SAID, "refused"), cells)


def cautions(thrusters: ThrusterFile | None, supply: float | None) -> list[str]:
    """Sentences about what does not fit together: thruster tests at other voltages than the vehicle's supply."""
    if supply is None or thrusters is None or thrusters.voltage_range_V is None:
        return []
    low, high = thrusters.voltage_range_V
    if low / ALIKE <= supply <= high * ALIKE:
        return []
    nearest = low if supply < low else high
    tested = " to ".join(dict.fromkeys(number(one, 3) for one in (low, high)))
    powers = (one.thrust_at_fixed_n for one in thrusters.voltage_exponent.values() if isinstance(one, VoltagePower))
    found = [one.value for one in powers if one is not None and one.value is not None]
    power = sum(found) / len(found) if found else None
    size = (
        f" Thrust grows with the voltage to the power {number(power, 3)}, so expect it to be "
        f"{number((supply / nearest) ** power, 3)} times that at {number(nearest, 3)} V."
        if power
        else ""
    )
    return [
        f"The thrusters were tested at {tested} V, the vehicle's supply is {number(supply, 3)} V: the map is "
        f"extrapolated.{size} Test at the supply voltage."
    ]
