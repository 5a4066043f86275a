# SPDX-License-Identifier: Apache-2.0
"""Our odometry and filters against FilterPy and SciPy, which share no code with them."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm, solve_discrete_are

ORACLE = Path(os.environ.get("REGISTA_BIN", "build/dev/bin")) / "oracle_control"


def ask(what, parameters, lines):
    """One list of numbers for each line."""
    text = "\n".join(" ".join(repr(float(v)) if not isinstance(v, str) else v for v in line) for line in lines)
    arguments = [ORACLE, what, *map(str, parameters)]
    done = subprocess.run(arguments, input=text + "\n", capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    answers = [np.array(line.split(), dtype=float) for line in done.stdout.splitlines()]
    assert len(answers) == len(lines)
    return answers


def wrap(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


def covariance_of(random, n, scale=1.0):
    root = random.normal(size=(n, n))
    return scale * (root @ root.T + 0.1 * np.eye(n))


# ---- Kalman filter against FilterPy ----------------------------------------------------------------------------------


@pytest.mark.parametrize("n, m", [(1, 1), (2, 1), (3, 2), (4, 2), (6, 3), (6, 4)])
@pytest.mark.parametrize("seed", range(5))
def test_kalman_filter_equals_filterpy_on_random_linear_systems(n, m, seed):
    random = np.random.default_rng(1000 * n + 100 * m + seed)
    reference = KalmanFilter(dim_x=n, dim_z=m)
    reference.P = np.eye(n)
    lines, expected = [], []
    for _ in range(100):
        f = random.normal(size=(n, n))
        f *= random.uniform(0.5, 1.1) / max(abs(np.linalg.eigvals(f)))
        q, r = covariance_of(random, n, 0.1), covariance_of(random, m, 0.5)
        h, u, z = random.normal(size=(m, n)), random.normal(size=(n, 1)), random.normal(size=(m, 1))
        lines.append(np.concatenate([a.ravel() for a in (f, q, u, h, r, z)]))
        reference.predict(u=u, B=np.eye(n), F=f, Q=q)
        reference.update(z, R=r, H=h)
        nis = (reference.y.T @ reference.SI @ reference.y).item()
        expected.append(np.concatenate([reference.x.ravel(), reference.P.ravel(), [nis]]))
    for ours, theirs in zip(ask("kalman", [n, m], lines), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


# ---- Odometry against numerical integration and the exponential map --------------------------------------------------


def motion(vx, vy, w, t):
    return expm(t * np.array([[0, -w, vx], [w, 0, vy], [0, 0, 0]]))


def test_odometry_equals_a_numerical_integrator():
    random = np.random.default_rng(1)
    rates = [0.0, 1e-9, -1e-5, 1e-3, -0.3, 2.0, 15.0]
    lines = [
        [random.uniform(-3, 3), random.uniform(-3, 3), random.choice(rates), random.integers(1, 3e8)] for _ in range(60)
    ]
    state = np.zeros(3)
    for (vx, vy, w, ns), ours in zip(lines, ask("odometry", [], lines), strict=True):

        def slope(_, s, vx=vx, vy=vy, w=w):
            return [vx * np.cos(s[2]) - vy * np.sin(s[2]), vx * np.sin(s[2]) + vy * np.cos(s[2]), w]

        state = solve_ivp(slope, (0, ns * 1e-9), state, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        np.testing.assert_allclose(ours[:2], state[:2], atol=1e-9)
        assert abs(wrap(ours[2] - state[2])) < 1e-9


@pytest.mark.parametrize("w", [0.0, 1e-12, 1e-8, 1e-4, 0.199, 0.201, 3.0, -20.0])
def test_odometry_equals_the_exponential_map_through_zero_turn_rate(w):
    ours = ask("odometry", [], [[1.5, -0.5, w, 1e9]])[0]
    theirs = motion(1.5, -0.5, w, 1.0)
    np.testing.assert_allclose(ours[:2], theirs[:2, 2], atol=1e-13)
    assert abs(wrap(ours[2] - np.arctan2(theirs[1, 0], theirs[0, 0]))) < 1e-13


# ---- Steady states against the algebraic Riccati equation ------------------------------------------------------------


@pytest.mark.parametrize("milliseconds", [1, 10, 16, 200])
def test_translation_filter_settles_on_the_riccati_solution(milliseconds):
    t, r = milliseconds / 1000, 0.004**2
    density = 40 * r  # Holtzhausen's ratio
    f = np.array([[1, t], [0, 1]])
    q = density * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
    before_update = solve_discrete_are(f.T, np.array([[1.0], [0]]), q, np.array([[r]]))
    lines = [["position", 0, 0, 0.004], ["predict", 0, 0, t * 1e9]] * int(10 / t)
    ours = ask("translation", [density], lines)[-1][4:].reshape(2, 2)
    np.testing.assert_allclose(ours, before_update, rtol=1e-9)


def test_orientation_filter_settles_on_the_riccati_solution():
    t, r, rate, bias = 0.016, 0.01**2, 2.5e-4, 1e-4
    f = np.array([[1, -t], [0, 1]])
    q = np.array([[rate * t + bias * t**3 / 3, -bias * t**2 / 2], [-bias * t**2 / 2, bias * t]])
    before_update = solve_discrete_are(f.T, np.array([[1.0], [0]]), q, np.array([[r]]))
    lines = [["heading", 0, 0.01], ["predict", 0, t * 1e9]] * 5000
    ours = ask("orientation", [rate, bias, 0.02], lines)[-1][2:].reshape(2, 2)
    np.testing.assert_allclose(ours, before_update, rtol=1e-9)


# ---- Translation and orientation filter against FilterPy -------------------------------------------------------------


def test_translation_filter_equals_filterpy_with_four_states():
    random = np.random.default_rng(2)
    density = 0.3
    reference = KalmanFilter(dim_x=4, dim_z=2)  # x, y, vx, vy
    reference.x = np.array([[1.0], [2], [0], [0]])
    reference.P = np.diag([0.01**2, 0.01**2, 1, 1])
    lines, expected = [["position", 1, 2, 0.01]], [None]
    one = np.eye(2)
    for _ in range(300):
        ns = int(random.integers(1, 5e7))
        t, a, z, sd = ns * 1e-9, random.normal(size=2), random.normal(size=2), random.uniform(0.005, 0.1)
        f = np.block([[one, t * one], [0 * one, one]])
        q = density * np.block([[t**3 / 3 * one, t**2 / 2 * one], [t**2 / 2 * one, t * one]])
        reference.predict(u=a.reshape(2, 1), B=np.block([[t**2 / 2 * one], [t * one]]), F=f, Q=q)
        lines.append(["predict", *a, ns])
        expected.append(None)
        kind = random.choice(["position", "velocity"])
        h = np.block([one, 0 * one]) if kind == "position" else np.block([0 * one, one])
        reference.update(z.reshape(2, 1), R=sd**2 * one, H=h)
        lines.append([str(kind), *z, sd])
        expected.append((reference.x.ravel().copy(), reference.P[::2, ::2].copy()))
    for ours, theirs in zip(ask("translation", [density], lines), expected, strict=True):
        if theirs is not None:
            np.testing.assert_allclose(ours[:4], theirs[0], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(ours[4:].reshape(2, 2), theirs[1], rtol=1e-9, atol=1e-12)


def test_orientation_filter_equals_filterpy_with_an_unwrapped_heading():
    random = np.random.default_rng(3)
    rate, bias = 1e-3, 1e-4
    reference = KalmanFilter(dim_x=2, dim_z=1)
    reference.x = np.array([[3.0], [0]])
    reference.P = np.diag([0.02**2, 0.05**2])
    lines, expected = [["heading", 3, 0.02]], [None]
    for _ in range(500):
        ns = int(random.integers(1, 5e7))
        t, w = ns * 1e-9, random.normal(loc=2)
        f = np.array([[1, -t], [0, 1]])
        q = np.array([[rate * t + bias * t**3 / 3, -bias * t**2 / 2], [-bias * t**2 / 2, bias * t]])
        reference.predict(u=np.array([[w]]), B=np.array([[t], [0]]), F=f, Q=q)
        z = reference.x[0, 0] + 0.05 * random.normal()
        reference.update(z, R=0.05**2, H=np.array([[1.0, 0]]))
        lines += [["predict", w, ns], ["heading", wrap(z), 0.05]]
        expected += [None, (reference.x.ravel().copy(), reference.P.copy())]
    assert reference.x[0, 0] > 15  # several turns
    for ours, theirs in zip(ask("orientation", [rate, bias, 0.05], lines), expected, strict=True):
        if theirs is not None:
            assert abs(wrap(ours[0] - theirs[0][0])) < 1e-9
            assert abs(ours[1] - theirs[0][1]) < 1e-9
            np.testing.assert_allclose(ours[2:].reshape(2, 2), theirs[1], rtol=1e-9, atol=1e-12)


# ---- Pose EKF against FilterPy, the exponential map and complex-step derivatives -------------------------------------


def moved(state, t):
    """x, y, heading, v, w, bias after t at constant v and w, as a product of matrices; takes complex numbers."""
    x, y, heading, v, w, bias = state
    c, s = np.cos(heading), np.sin(heading)
    end = np.array([[c, -s, x], [s, c, y], [0, 0, 1]]) @ motion(v, 0, w, t)
    return np.array([end[0, 2], end[1, 2], heading + w * t, v, w, bias])


def derivative(state, t):
    columns = [moved(state + 1e-30j * unit, t).imag / 1e-30 for unit in np.eye(6)]
    return np.array(columns).T


def process_noise(state, t, acceleration, turn, bias, slip):
    """Integrated white noise; that of the speed along the chord of the step."""
    way = (moved(state, t) - state)[:2].real / (state[3] * t)
    q = np.diag([slip * t, slip * t, turn * t**3 / 3, acceleration * t, turn * t, bias * t])
    q[2, 4] = q[4, 2] = turn * t**2 / 2
    q[:2, :2] += acceleration * t**3 / 3 * np.outer(way, way)
    q[:2, 3] = q[3, :2] = acceleration * t**2 / 2 * way
    return q


H = {
    "wheels": np.eye(6)[3:5],
    "gyro": np.array([[0, 0, 0, 0, 1.0, 1.0]]),
    "heading": np.eye(6)[2:3],
    "position": np.eye(6)[:2],
}


@pytest.mark.parametrize("seed", range(3))
def test_pose_ekf_equals_filterpy(seed):
    random = np.random.default_rng(40 + seed)
    noise = [0.3, 0.2, 1e-6, 1e-3]
    ekf = ExtendedKalmanFilter(dim_x=6, dim_z=2)
    ekf.x = np.array([3.0, 4, 2, 0, 0, 0])
    ekf.P = np.diag([0.5, 0.5, 0.1, 1, 1, 0.05]) ** 2
    lines, expected = [["reset", 3, 4, 2, 0.5, 0.1]], [None]

    def update(name, z, sds):
        h = H[name]

        def residual(a, b):
            return wrap(a - b) if name == "heading" else a - b

        ekf.update(np.array(z), HJacobian=lambda _: h, Hx=lambda x: h @ x, R=np.diag(np.square(sds)), residual=residual)
        lines.append([name, *z, *(sds[:1] if name == "position" else sds)])
        expected.append((ekf.x.copy(), ekf.P.copy()))

    update("wheels", [0.5, 0.3], [0.05, 0.1])
    for step in range(300):
        ns = int(random.integers(1e6, 5e7))
        f = derivative(ekf.x, ns * 1e-9)
        q = process_noise(ekf.x, ns * 1e-9, *noise)
        ekf.x = moved(ekf.x, ns * 1e-9)
        ekf.P = f @ ekf.P @ f.T + q
        lines.append(["predict", ns])
        expected.append((ekf.x.copy(), ekf.P.copy()))
        update("wheels", [0.5 + 0.05 * random.normal(), 0.8 + 0.1 * random.normal()], [0.05, 0.1])
        update("gyro", [0.83 + 0.02 * random.normal()], [0.02])
        if step % 5 == 0:
            update("heading", [ekf.x[2] + 0.1 * random.normal()], [0.1])
        if step % 7 == 0:
            update("position", ekf.x[:2] + random.normal(size=2), [1.0, 1.0])
    assert ekf.x[2] > 2 * np.pi  # through the wrap
    for ours, theirs in zip(ask("pose", noise, lines), expected, strict=True):
        if theirs is not None:
            error = ours[:6] - theirs[0]
            error[2] = wrap(error[2])
            np.testing.assert_allclose(error, 0, atol=1e-9)
            np.testing.assert_allclose(ours[6:].reshape(6, 6), theirs[1], rtol=1e-9, atol=1e-9)


def test_pose_ekf_process_noise_agrees_with_the_integral_over_the_step():
    # Without the simplification: q = integral of F(s) G F(s)', where the white noise acts at every instant of the step.
    noise = dict(acceleration=0.3, turn=0.2, bias=1e-6, slip=1e-3)
    state, t = np.array([0, 0, 0.7, 1.2, 0.9, 0]), 0.02

    def at(s):
        middle = moved(state, t - s)
        heading = middle[2]
        g = np.diag([noise["slip"], noise["slip"], 0, noise["acceleration"], noise["turn"], noise["bias"]])
        f = derivative(np.array([0, 0, heading, *state[3:]]), s)
        return f @ g @ f.T

    exact = quad_vec(at, 0, t)[0]
    ours = process_noise(state, t, **noise)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert np.max(abs(exact - ours) / scale) < 0.02
