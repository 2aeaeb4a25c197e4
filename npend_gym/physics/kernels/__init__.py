"""Compiled physics. Arrays in, arrays out: no checks, no exceptions, no allocation in loops.

dynamics has the equations, states evaluates them for many states; rk4, pairs and gauss take steps,
methods names them; turning_points says when a bob turns, releases measures a release; layout names
the fields of many chains, advance takes their steps, tape and gauss_derivatives differentiate those
of a motion. Equations and steps are written for numbers that are floats, one chain, or packs (see
`npend_gym.compiled.packs`), many chains side by side.

Joint j lies between rod j-1 and rod j, joint 0 at the pivot.

Symbols, the paper's where it has them (S. Charles 2019, its rods 1..N are 0..n-1 here)::

    theta, omega, alpha   angle, angular velocity, angular acceleration of each rod
    v_j = 1/m_{j-1}       inverse mass at joint j; v_0 = 0, because the pivot cannot move
    l, 1/l, g             rod length, its inverse, gravity
    s_j, c_j              sine and cosine of theta_j - theta_{j-1}; at joint 0 of theta_0
    tau_j                 torque at joint j: of the motor, minus that of damping; tau_n = 0
    f_i = Q_i / l_i       force couple that carries the net torque Q_i = tau_i - tau_{i+1} of rod i
    T_i                   tension of rod i
"""
