"""ArduSub as a vehicle that plays campaigns."""

from collections.abc import Generator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path

from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.ardusub.packets import Clock, Halt, Link, reached_by
from automarine_cli.link.vehicles.ardusub.preflight import Need, preflight
from automarine_cli.link.vehicles.ardusub.ride import Limits, Ride
from automarine_cli.link.vehicles.ardusub.sticks import Authority, authority
from automarine_cli.link.vehicles.base import Halted
from automarine_cli.simulation.checks import between


@dataclass(frozen=True)
class ArduSub:
    """A vehicle with ArduSub at a MAVLink address. The whole output gives `full` in the campaign's unit, or what two
    `thrusters` at an `arm` [m] do."""

    address: str
    full: float | None = None
    thrusters: Path | None = None
    arm: float | None = None
    limits: Limits = field(default_factory=Limits)
    clock: Clock = field(default_factory=Clock)

    def __post_init__(self) -> None:
        reached_by(self.address)
        if self.full is not None:
            between(self, 1e-9, 1e9, "full")

    def refuse(self, campaign: LinkCampaign) -> None:
        self._authority(campaign)

    def look(self, campaign: LinkCampaign) -> None:
        """Check the vehicle as before a run, and command nothing. Raises SettingError."""
        with closing(Link(self.address, lambda: False, self.clock)) as link:
            preflight(link, Need.of(campaign, 0, self._authority(campaign), self.limits.depth))

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        """The lines of a run's log: the moment as the vehicle's outputs made it, and the outputs.

        Each run is a whole: the vehicle is checked, armed, driven, turned back and disarmed, then there is silence.
        Raises SettingError where the vehicle must not be driven, or not any further.
        """
        run, known = campaign.runs[number], self._authority(campaign)
        after = campaign.runs[min(number + 1, len(campaign.runs) - 1)]
        with closing(Link(self.address, halted, self.clock)) as link, suppress(Halt):
            stick, part = preflight(link, Need.of(campaign, number, known, self.limits.depth))
            ride = Ride(link, stick, part, known, self.limits)
            cut: Exception | None = None
            try:
                ride.begin(run.start_heading_deg)
                yield ride.head(campaign, campaign.log_name(run))
                try:
                    yield from ride.lines(campaign, number)
                except (Halt, SettingError) as problem:
                    cut = problem
                else:
                    ride.unwind(after.start_heading_deg)
            finally:
                ride.end()
            if cut is not None:
                yield from ride.rows()  # they end in neutral
                raise cut

    def _authority(self, campaign: LinkCampaign) -> Authority:
        return authority(campaign, self.full, self.thrusters, self.arm)
