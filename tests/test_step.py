"""A step is a function that owns nothing: several threads take and differentiate steps at once."""

import threading
import tracemalloc

import numpy as np
import pytest

from npend_gym import Cart, Chain

pytestmark = pytest.mark.long  # kernels of their own take long to compile

torch = pytest.importorskip("torch")

from npend_gym.torch import step  # noqa: E402

LINKS = Chain([1.0] * 3, [0.8] * 3, centres=0.4, inertias=0.05, friction=0.1)
JOBS = [
    (Chain.uniform(2), (1,), ("masses", "lengths")),
    (Chain.uniform(5, damping=0.1), (17,), ("gravity",)),
    (Chain.uniform(2, drag=0.1), (4, 3), ("masses", "drag")),
    (Chain.uniform(1, base=Cart(1.5, 0.1)), (9,), ()),
    (LINKS, (2, 8), ("friction", "lengths")),
    (Chain.uniform(5, damping=0.1), (64,), ("damping",)),
]


def job(number, steps=3):
    """Return the leaves of a rollout of one of the jobs, and a function that takes its steps."""
    chain, batch, names = JOBS[number % len(JOBS)]
    rng, m = np.random.default_rng(number), chain.coordinates
    arrays = [0.5 * rng.normal(size=(*batch, m)) for _ in range(2)]
    arrays.append(rng.normal(size=(*batch, chain.n + (chain.base is not None))))
    arrays += [np.asarray(getattr(chain, name)) * 1.1 for name in names]
    leaves = [torch.tensor(x, requires_grad=True) for x in arrays]

    def forward():
        state, parameters = leaves[:2], dict(zip(names, leaves[3:], strict=True))
        for _ in range(steps):
            state = step(chain, *state, leaves[2], parameters, dt=0.03, joints=range(chain.n))
        return state

    return leaves, forward


def results(number):
    """Return the states and gradients of a job, as bytes."""
    leaves, forward = job(number)
    q, u = forward()
    gradients = torch.autograd.grad(q.sum() + 2.0 * u.square().sum(), leaves)
    return [x.detach().numpy().tobytes() for x in (q, u, *gradients)]


def in_threads(work, count):
    """Return ``work(k)`` of `count` threads that begin together."""
    found, failures, together = [None] * count, [], threading.Barrier(count)

    def run(k):
        try:
            together.wait(60.0)
            found[k] = work(k)
        except BaseException as error:  # noqa: BLE001 - raised below
            failures.append(error)

    threads = [threading.Thread(target=run, args=(k,)) for k in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]
    return found


def test_threads_that_differentiate_at_once_have_the_bits_of_one_thread():
    expected = [results(k) for k in range(len(JOBS))]
    got = in_threads(lambda k: [results((k + j) % len(JOBS)) for j in range(20)], 4)
    for k, rounds in enumerate(got):
        for j, found in enumerate(rounds):
            assert found == expected[(k + j) % len(JOBS)], JOBS[(k + j) % len(JOBS)]


def test_a_backward_pass_may_run_in_another_thread_than_the_steps():
    """Forward passes of all jobs here, their backward passes each in a thread of its own."""
    graphs = [(leaves, forward()) for leaves, forward in map(job, range(len(JOBS)))]

    def back(k):
        leaves, (q, u) = graphs[k]
        gradients = torch.autograd.grad(q.sum() + 2.0 * u.square().sum(), leaves)
        return [x.detach().numpy().tobytes() for x in (q, u, *gradients)]

    got = in_threads(back, len(JOBS))
    assert got == [results(k) for k in range(len(JOBS))]


class Rollout(torch.nn.Module):
    """Masses that are learnt, and a rollout with a linear controller."""

    def __init__(self):
        super().__init__()
        self.chain = Chain.uniform(2)
        self.log_masses = torch.nn.Parameter(torch.zeros(2, dtype=torch.float64))
        self.gain = torch.nn.Parameter(torch.full((2, 1), -0.3, dtype=torch.float64))

    def forward(self, theta):
        omega, masses = torch.zeros_like(theta), self.log_masses.exp()
        for _ in range(5):
            torque = theta @ self.gain
            theta, omega = step(self.chain, theta, omega, torque, {"masses": masses}, dt=0.02)
        return theta.square().sum() + omega.square().sum()


def test_two_threads_use_one_module():
    module, rng = Rollout(), np.random.default_rng(0)
    starts = [torch.from_numpy(rng.normal(size=(size, 2))) for size in (1, 7, 7, 30)]

    def gradients(k):
        found = [torch.autograd.grad(module(starts[k]), [*module.parameters()]) for _ in range(20)]
        return [[x.numpy().tobytes() for x in each] for each in found]

    expected = [gradients(k)[0] for k in range(4)]
    for k, found in enumerate(in_threads(gradients, 4)):
        assert all(each == expected[k] for each in found)


def test_calls_do_not_grow_the_memory():
    rng = np.random.default_rng(0)

    def use(count):
        for k in range(count):  # chains, sizes and parameters that no call had before
            theta = torch.from_numpy(rng.normal(size=(1 + k % 13, 2))).requires_grad_()
            masses = torch.from_numpy(rng.uniform(0.5, 1.5, 2)).requires_grad_()
            after, _ = step(Chain.uniform(2, float(rng.uniform(0.5, 1.5))), theta,
                            parameters={"masses": masses}, dt=0.01, substeps=1 + k % 3)  # fmt: skip
            after.sum().backward()

    use(300)
    tracemalloc.start()
    try:
        use(100)
        before = tracemalloc.get_traced_memory()[0]
        use(300)
        assert tracemalloc.get_traced_memory()[0] - before < 400_000
    finally:
        tracemalloc.stop()
