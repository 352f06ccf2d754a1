"""The text of `controller.py`: a controller without libraries that a person can read, change and fly."""

from automarine_cli import __version__
from automarine_cli.control.targets.base import Design

TEMPLATE = '''"""Controller of {motion}: position in, output from -1 to 1 out. Call `step` every {period} s.

{notes}
"""

from math import copysign{pi}

PERIOD = {period}  # s
INERTIA = {inertia}  # {inertia_unit}
LINEAR = {drag}  # {linear_unit}
QUADRATIC = {squared}  # {quadratic_unit}
FULL = {full}  # {force_unit} at output 1
VELOCITY = {velocity}  # rad/s, closed-loop frequency of the velocity
POSITION = {position}  # 1/s, velocity asked for per error of position
REFERENCE = {reference}  # rad/s, frequency of the reference model
RATE = {rate}  # {x}/s, fastest velocity of the reference
ACCELERATION = {acceleration}  # {x}/s^2, its largest acceleration
OUTPUTS = {outputs}
SHARES = {shares}  # of FULL at these outputs, as the thruster map has it


def within(value, most):
    return min(max(value, -most), most)


def output_for(share):
    """The output that gives a share of the full {force}: the map inverted, across its dead-band."""
    size = abs(share)
    if size == 0.0:
        return 0.0
    for k in range(1, len(SHARES)):
        if size <= SHARES[k]:
            rest = (size - SHARES[k - 1]) / (SHARES[k] - SHARES[k - 1])
            return copysign(OUTPUTS[k - 1] + rest * (OUTPUTS[k] - OUTPUTS[k - 1]), share)
    return copysign(1.0, share)


class Controller:
    def __init__(self, position):
        """Start where the vehicle is, at rest."""
        self.model, self.slope, self.integral = position, 0.0, 0.0

    def step(self, reference, position, velocity):
        """{angles}velocity [{x}/s] measured -> output from -1 to 1."""
{wrapped}        # reference model: second order, no faster than the thrusters can follow
        pull = within(REFERENCE**2 * (reference - self.model) - 2.0 * REFERENCE * self.slope, ACCELERATION)
        after = within(self.slope + pull * PERIOD, RATE)
        pull, self.slope = (after - self.slope) / PERIOD, after
        self.model += self.slope * PERIOD
        # feedback linearisation: the drag is made up for, what is left is an inertia
        error = self.slope + POSITION * (self.model - position) - velocity
        drag = LINEAR * velocity + QUADRATIC * abs(velocity) * velocity
        now = INERTIA * (pull + 2.0 * VELOCITY * error) + drag
        # the integral rests while the output is at its limit and would be carried further
        grown = self.integral + INERTIA * VELOCITY**2 * PERIOD * error
        out = (now + grown) / FULL
        if not (abs(out) > 1.0 and out * error > 0):
            self.integral = grown
        return output_for(within((now + self.integral) / FULL, 1.0))
'''


def controller(design: Design, period: float) -> str:
    """The file's text; numbers to eight digits."""
    own, model, dof = design.gains, design.nominal, design.nominal.dof
    bend, turns = model.bend, dof.wraps
    if bend is None:
        outputs, shares = [0.0, 1.0], [0.0, 1.0]
    else:
        first = int((bend.share <= 0.0).sum()) - 1
        outputs, shares = bend.output[first:].tolist(), bend.share[first:].tolist()
    wrap = "        # the heading counts on over north, as the model does\n" if turns else ""
    wrap += (
        (
            "        position += 2.0 * pi * round((self.model - position) / (2.0 * pi))\n"
            "        reference += 2.0 * pi * round((self.model - reference) / (2.0 * pi))\n"
        )
        if turns
        else ""
    )
    lines = [f"Written by automarine {__version__}.", *design.notes]
    scaled = {name: f"{own[name] * model.full:.8g}" for name in ("inertia", "drag", "squared")}
    plain = {name: f"{own[name]:.8g}" for name in ("velocity", "position", "reference", "rate", "acceleration")}
    return TEMPLATE.format(
        motion=dof.name, period=f"{period:g}", notes="\n".join(lines), pi=", pi" if turns else "", **scaled, **plain,
        full=f"{model.full:.8g}", force_unit=model.force_unit, x=dof.units.base, force=dof.words.force,
        inertia_unit=dof.unit_of("inertia", model.force_unit), linear_unit=dof.unit_of("linear", model.force_unit),
        quadratic_unit=dof.unit_of("quadratic", model.force_unit),
        outputs="[" + ", ".join(f"{one:.6g}" for one in outputs) + "]",
        shares="[" + ", ".join(f"{one:.6g}" for one in shares) + "]",
        angles=f"Reference and {dof.words.position} [{dof.units.base}], ", wrapped=wrap,
    )  # fmt: skip
