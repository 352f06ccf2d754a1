"""MSS: a MATLAB function with M, C and D of surge, sway and yaw, as the vessels of Fossen's toolbox have them.

M nu_r' + C(nu_r) nu_r + D(nu_r) nu_r = tau. Sources: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion
Control, section 6.5; MSS, CRAFT/USV/models/otter.m.
"""

from automarine_cli.exports.base import Written, commented, number
from automarine_cli.exports.planar import PlanarSubject
from automarine_cli.models.planar import VELOCITIES

FILE = """function [nu_dot, M, C, D] = vehicle3(nu, tau, nu_c)
{head}%
% [nu_dot, M, C, D] = vehicle3(nu, tau, nu_c): accelerations of nu = [u v r]' under tau = [X Y N]' in water that moves
% with nu_c = [u_c v_c 0]' in the vehicle's axes (default: still). Drag is positive where it resists.
if nargin < 3
    nu_c = zeros(3, 1);
end
nu_r = nu(:) - nu_c(:);
u = nu_r(1); v = nu_r(2); r = nu_r(3);
M = [{inertia}];
p = M * nu_r;
C = [0 0 -p(2); 0 0 p(1); p(2) -p(1) 0];
D = zeros(3);
{drag}tau_0 = [{constant}]';  % always acts
% the current's part of nu turns with the vehicle
nu_c_dot = [nu(3) * nu_c(2); -nu(3) * nu_c(1); 0];
nu_dot = M \\ (tau(:) + tau_0 - C * nu_r - D * nu_r) + nu_c_dot;
end
"""


def write(subject: PlanarSubject) -> Written:
    """The text of the function."""
    lines = []
    for name, places, value in subject.drags():
        i, j = places[0], places[-1]
        size = f" * abs({VELOCITIES[places[1]]})" if len(places) == 3 else ""
        lines.append(
            f"D({i + 1},{j + 1}) = D({i + 1},{j + 1}) + {number(value)}{size};  % {name}, positive where it resists\n"
        )
    rows = "; ".join(" ".join(number(one) for one in line) for line in subject.inertia)
    text = FILE.format(
        head=commented(subject.head(), "%"),
        inertia=rows,
        drag="".join(lines),
        constant=" ".join(number(one) for one in subject.constant),
    )
    return Written(text, subject.about_water())
