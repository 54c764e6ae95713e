"""The ships' equations written out term by term as the sources print them: the second route to every force.

Plain numbers in SI; the rudder is the source's, positive to port.
"""

from math import hypot


def wang(k, inertia, length, speed, u, v, r, d):
    """Wang 1996, eqs 3.6-3.11 with the tables' coefficients; udot, vdot, rdot."""
    a, b, q = (u - speed) / speed, v / speed, r * length / speed
    X, Y, N = k["X"], k["Y"], k["N"]
    fx = X["u"] * a + X["uu"] * a**2 / 2 + X.get("uuu", 0) * a**3 / 6 + X["vv"] * b**2 / 2 + X["rr"] * q**2 / 2
    fx += X["dd"] * d**2 / 2 + X["vr"] * b * q + X.get("vd", 0) * b * d

    def lateral(c):
        f = c.get("0", 0) + c["v"] * b + c["vvv"] * b**3 / 6 + c.get("vrr", 0) * b * q**2 / 2
        f += c.get("vdd", 0) * b * d**2 / 2 + c["r"] * q + c.get("rrr", 0) * q**3 / 6 + c.get("rvv", 0) * q * b**2 / 2
        return f + c["d"] * d + c["ddd"] * d**3 / 6 + c.get("dvv", 0) * d * b**2 / 2

    fy, fn = lateral(Y), lateral(N)
    my, mz, y_rdot, n_vdot = inertia["my"], inertia["mz"], inertia.get("Yrdot", 0), inertia.get("Nvdot", 0)
    # my v' - Yrdot L r' = fy and -Nvdot v' + mz L r' = fn, both times U0^2/L.
    determinant, unit = my * mz - y_rdot * n_vdot, speed**2 / length
    vdot = unit * (mz * fy + y_rdot * fn) / determinant
    rdot = unit * (n_vdot * fy + my * fn) / determinant / length
    return fx / inertia["mx"] * unit, vdot, rdot


def chislett(u, v, r, d):
    """Chislett & Strom-Tejsen 1965 as Fossen 1994, E.1.3, prints them; udot, vdot, rdot."""
    length, nominal, mass, xg, iz = 160.93, 7.7175, 798e-5, -0.023, 39.2e-5
    U = hypot(u, v)
    u, v, r = (u - nominal) / U, v / U, r * length / U
    m11, m22, m33 = mass + 42e-5, mass + 748e-5, iz + 43.8e-5
    m23, m32 = mass * xg + 9.354e-5, mass * xg - 4.646e-5
    X = -184e-5 * u - 110e-5 * u**2 - 215e-5 * u**3 - 899e-5 * v**2 + 18e-5 * r**2 + 798e-5 * r * v
    X += -95e-5 * d**2 - 190e-5 * u * d**2 + 93e-5 * v * d + 93e-5 * u * v * d
    Y = -1160e-5 * v - 499e-5 * r - 8078e-5 * v**3 + 15356e-5 * v**2 * r - 1160e-5 * v * u - 499e-5 * r * u
    Y += 278e-5 * d - 90e-5 * d**3 + 556e-5 * u * d + 278e-5 * u**2 * d - 4e-5 * v * d**2 + 1190e-5 * v**2 * d
    Y += -4e-5 - 8e-5 * u - 4e-5 * u**2
    N = -264e-5 * v - 166e-5 * r + 1636e-5 * v**3 - 5483e-5 * v**2 * r - 264e-5 * v * u - 166e-5 * r * u
    N += -139e-5 * d + 45e-5 * d**3 - 278e-5 * u * d - 139e-5 * u**2 * d + 13e-5 * v * d**2 - 489e-5 * v**2 * d
    N += 3e-5 + 6e-5 * u + 3e-5 * u**2
    determinant = m22 * m33 - m23 * m32
    vdot = (m33 * Y - m23 * N) / determinant
    rdot = (-m32 * Y + m22 * N) / determinant
    return X / m11 * U**2 / length, vdot * U**2 / length, rdot * U**2 / length**2


def esso(u, v, r, d, zeta=0.0, rpm=80.0):
    """Rajesh & Bhattacharyya 2009, eqs 1-15 with Table 1; udot, vdot, rdot."""
    L, g, n = 304.8, 9.81, rpm / 60
    thrust = (-0.00695 * u**2 / L - 0.00063 * u * n + L * 3.54e-5 * abs(n) * n) / g
    c2 = 0.605 * u * n + 38.2 * n**2
    beta = v / u
    cross = c2 * abs(beta) * beta * abs(d)
    yuv_zeta = 0.0 if zeta < 0.8 else -0.85 * (1 - 0.8 / zeta)
    x = (-0.0377 - 0.0061 * zeta) * u**2 / L + (2.02 + 0.387 * zeta) * v * r + (0.3 + 0.0125 * zeta**2) * v**2 / L
    x += -0.093 * c2 * d**2 / L + 0.152 * c2 * beta * d / L + g * thrust * (1 - 0.22)
    y = (-1.205 + yuv_zeta * zeta) * u * v / L + (-2.4 - 1.5 * zeta) * abs(v) * v / L + 0.208 * c2 * d / L
    y += (-0.752 + 0.182 * zeta) * u * r + (-2.16 - 0.191 * zeta) * cross / L + 0.04 * g * thrust
    nn = (-0.451 - 0.241 * zeta) * u * v / L**2 + (-0.3 - 0.12 * zeta) * abs(v) * r / L - 0.098 * c2 * d / L**2
    nn += (-0.231 - 0.047 * zeta) * u * r / L + (0.688 + 0.344 * zeta) * cross / L**2 - 0.02 * g * thrust / L
    return x / (1.05 + 0.05 * zeta), y / (2.02 + 0.387 * zeta), nn / (0.1232 + 0.0045 * zeta)
