"""The equations of motion of links and springs, as SymPy derives them: slow and obvious."""

from functools import cache

import numpy as np

_PER_LINK = (
    "masses", "lengths", "centres", "inertias", "damping", "drag", "quadratic_drag", "friction",
    "friction_speed", "armature", "gear",
)  # fmt: skip


@cache
def _derive(n, modules, stretching=False):
    """Return a function for M and f of M q'' = f, q = (x, y, theta): the pivot is free to move.

    Links on springs have their stretch at the end of q.
    """
    import sympy as sp

    size = n + 2 + n * stretching
    q, u = sp.symbols(f"q:{size}"), sp.symbols(f"u:{size}")
    stiffness, axial = sp.symbols(f"K:{n}"), sp.symbols(f"D:{n}")
    m, l, c, inertia, damping, drag, square, friction, slow, armature, back, torque = (
        sp.symbols(f"{name}:{n}") for name in "mlcidkvfsabt"
    )
    cart, push, g = sp.symbols("M F g")
    speeds = sp.Matrix(u)
    kinetic, potential, force = cart * (u[0] ** 2 + u[1] ** 2) / 2, 0, sp.zeros(size, 1)
    force[0] = push
    joint = sp.Matrix(q[:2])
    for i in range(n):
        along, above = sp.Matrix([sp.sin(q[i + 2]), -sp.cos(q[i + 2])]), u[i + 1] if i else 0
        centre = joint + c[i] * along
        joint = joint + l[i] * along  # the tip
        if stretching:
            stretch = q[n + 2 + i]
            centre, joint = centre + stretch * along, joint + stretch * along
            potential += stiffness[i] * stretch**2 / 2
            force[n + 2 + i] -= axial[i] * u[n + 2 + i]
        moving, tip = centre.jacobian(q) * speeds, joint.jacobian(q) * speeds
        kinetic += m[i] * moving.dot(moving) / 2 + inertia[i] * u[i + 2] ** 2 / 2
        kinetic += armature[i] * ((back[i] - 1) * above + u[i + 2]) ** 2 / 2  # back = 1/gear
        potential += m[i] * g * centre[1]
        force -= joint.jacobian(q).T * (drag[i] + square[i] * sp.sqrt(tip.dot(tip))) * tip
        relative = u[i + 2] - above
        u_scaled = relative / slow[i]
        held = torque[i] - damping[i] * relative
        held -= friction[i] * u_scaled / sp.sqrt(1 + u_scaled**2)
        force[i + 2] += held
        if i > 0:
            force[i + 1] -= held
    lagrange = sp.Matrix([kinetic - potential])
    momenta = lagrange.jacobian(u)
    force += lagrange.jacobian(q).T - momenta.jacobian(q) * speeds
    own = (m, l, c, inertia, damping, drag, square, friction, slow, armature, back)
    own += (stiffness, axial) if stretching else ()
    symbols = (q, u, own, torque, cart, push, g)
    return sp.lambdify(symbols, (momenta.jacobian(u), force), modules=modules, cse=True)


def system(chain, theta, omega, torque, cart=1.0, push=0.0, velocity=(0.0, 0.0), *, exact=False):
    """Return M and f of a chain on a pivot that may move, of 50 digits where `exact`."""
    rows = [getattr(chain, name) for name in _PER_LINK]
    rows[-1] = 1.0 / rows[-1]
    values = ([0.0, 0.0, *theta], [*velocity, *omega], rows, torque, cart, push, chain.gravity)
    if exact:
        import mpmath

        mpmath.mp.dps = 50
        plain = [np.asarray(value, float).tolist() for value in values]
        return _derive(chain.n, "mpmath")(*_map(mpmath.mpf, plain))
    matrix, force = _derive(chain.n, "numpy")(*values)
    return matrix, force[:, 0]


def accelerations(chain, theta, omega, torque):
    """Return the angular accelerations with the pivot at rest, to the last digit of float64."""
    import mpmath

    matrix, force = system(chain, theta, omega, torque, exact=True)
    return np.array([*map(float, mpmath.lu_solve(matrix[2:, 2:], force[2:, :]))])


def all_accelerations(values, q, u, loads, base=None):
    """Return u' of the coordinates in the package's order: angles, base, and stretch of springs.

    `values` has the parameters by name, with "stiffness" for springs; `base` is {"acceleration": a}
    or {"cart_mass": M, "rail_damping": d}. All may be complex, for derivatives by complex steps.
    """
    n = len(values["masses"])
    base, stretching = base or {}, "stiffness" in values
    moving = len(q) - n - n * stretching
    order = [*range(n, n + moving), *range(n), *range(n + moving, len(q))]
    state = [np.insert(np.asarray(x)[order], moving, [0.0] * (2 - moving)) for x in (q, u)]
    rows = [values[name] for name in _PER_LINK[:-1]] + [1.0 / values["gear"]]
    rows += [values["stiffness"], values["axial_damping"]] if stretching else []
    mass, push, free = 1.0, 0.0, [*range(2, 2 + len(q) - moving)]
    if moving == 1:
        mass, push, free = base["cart_mass"], loads[n] - base["rail_damping"] * u[n], [0, *free]
    derived = _derive(n, "numpy", stretching)
    matrix, force = derived(*state, rows, loads[:n], mass, push, values["gravity"])
    given = np.asarray(base.get("acceleration", (0.0, 0.0)))
    right = force[free, 0] - matrix[np.ix_(free, [0, 1])] @ given
    found = np.linalg.solve(matrix[np.ix_(free, free)], right)
    carried = found[:1] if moving == 1 else given[:moving]
    found = found[moving == 1 :]
    return np.concatenate([found[:n], carried, found[n:]])


def accelerations_of_chain(chain, q, u, loads, acceleration=None):
    """Return `all_accelerations` of a chain, whose pivot may have an acceleration."""
    names = [*_PER_LINK, "gravity"]
    names += [] if chain.stiffness is None else ["stiffness", "axial_damping"]
    base = None if acceleration is None else {"acceleration": acceleration}
    if chain.base is not None:
        base = {"cart_mass": chain.base.mass, "rail_damping": chain.base.damping}
    return all_accelerations({name: getattr(chain, name) for name in names}, q, u, loads, base)


def _map(function, values):
    return [_map(function, one) if isinstance(one, list) else function(one) for one in values]
