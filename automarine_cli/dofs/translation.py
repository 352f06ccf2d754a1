"""What surge, sway and heave have in common: metres, newtons, and drag that may differ between the two ways."""

from math import inf

from automarine_cli.dofs.dof import Limits, Symbols, Units, Words

METRES = Units(base="m", log="m", per_base=1.0, shown="cm", shown_per_base=100.0, mark=" cm", forces=("nu", "N"))

LIMITS = Limits(
    trim=inf,
    least=0.3,
    still=0.05,
    start=0.1,
    plausible=(0.02, 20.0),
    spike=0.1,
    end_spike=0.35,
    large_step=inf,  # nothing wraps
    jump=0.25,
    acceleration=20.0,  # twice that of a free fall
    far=5000.0,  # ten minutes at the speed of a small boat
    fast=15.0,
    position_sd=10.0,
    velocity_sd=1.0,
    bias_sd=0.2,
    least_noise=0.002,
    long=5.0,
)


def symbols(force: str, velocity: str, position: str) -> Symbols:
    """The letters of a translation, as Fossen has them: force `X`, velocity `u`, position `x`, derivatives `X_u`."""
    drag, letter = f"{force}_{velocity}", velocity
    return Symbols(
        position=position,
        position_print=position,
        position_math=position,
        velocity=letter,
        force=force,
        force_print=force,
        force_math=force,
        inertia=f"m_{letter}",
        inertia_math=f"m_{letter}",
        linear=drag,
        linear_math=drag,
        quadratic=drag + letter,
        quadratic_print=f"{drag}|{letter}|",
        quadratic_math=f"{force}_{{{letter}|{letter}|}}",
        cubic=drag + 2 * letter,
        water=f"{letter}_w",
    )


def words(name: str, position: str, ways: tuple[str, str]) -> Words:
    """The words of a translation called `name` whose logs hold a `position` (distance, depth)."""
    return Words(
        position=position,
        sensor=f"{position} sensor",
        rate=f"{name} speed",
        speed="speed",
        force="force",
        full_force=f"{name} force",
        inertia="mass",
        an_inertia="a mass",
        full_inertia="mass with added mass",
        inertial_length="inertial distance",
        travelled="distance covered",
        step="step",
        reach="the way allowed",
        whole_way="the whole way",
        back_again="back again",
        move="move",
        moves="moves",
        moved="moved",
        moving="moving",
        unit="cm",
        units="cm",
        units_of_way="cm of way",
        spring="spring",
        stiffness="stiffness",
        ways=ways,
        to_ways=ways,
        both_ways="both ways",
        each_way="each way",
        one_way="one way",
        other_way="the other way",
        gone_key="covered",
        the_other="the other",
        way="direction",
        rate_sensor="speed sensor",
        way_key="travel",
        range_key="covered_m",
    )
