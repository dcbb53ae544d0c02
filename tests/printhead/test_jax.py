"""The printhead as functions of JAX: the same numbers as those of PyTorch."""

import numpy as np
import pytest

jax = pytest.importorskip("jax", reason="inkjet_env.jax needs JAX, the extra jax")
torch = pytest.importorskip("torch", reason="what JAX computes is compared with PyTorch, the extra rl")

import inkjet_env.torch  # noqa: E402
from inkjet_env.jax import HeadParameters, peak_cost, response  # noqa: E402
from inkjet_env.printhead import Bounds, Printhead, batch  # noqa: E402

HEAD = Printhead.published()
PARAMETERS = HeadParameters.of(HEAD)
ROWS = Bounds().from_unit(np.random.default_rng(0).uniform(-1, 1, (5, 7)))
TIME_S = np.linspace(0, 100e-6, 11)


@pytest.fixture(autouse=True)
def double_precision():
    with jax.enable_x64(True):
        yield


def test_costs_and_gradients_are_those_of_the_simulator_under_jit_and_vmap():
    costs, gradients = batch.costs_and_gradients(ROWS, HEAD)
    np.testing.assert_array_equal(peak_cost(ROWS, HEAD), costs)
    np.testing.assert_array_equal(jax.jit(jax.vmap(lambda row: peak_cost(row, HEAD)))(ROWS), costs)
    mapped = jax.jit(jax.vmap(jax.grad(lambda row: peak_cost(row, HEAD))))(ROWS)
    np.testing.assert_array_equal(mapped, gradients)


def test_gradients_in_the_head_are_those_of_pytorch():
    found = jax.grad(lambda head: peak_cost(ROWS, head).sum())(PARAMETERS)
    tensors = [value.requires_grad_() for value in inkjet_env.torch.head_parameters(HEAD)]
    costs = inkjet_env.torch.peak_cost(torch.from_numpy(ROWS), HeadParameters(*tensors))
    for mine, other in zip(found, torch.autograd.grad(costs.sum(), tensors), strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-12)


def test_the_jacobian_of_the_response_is_that_of_pytorch():
    def signal(row, head):
        return response(row, TIME_S, head, period_s=120e-6)

    by_row, by_head = jax.jit(jax.jacrev(signal, argnums=(0, 1)))(ROWS[0], PARAMETERS)

    def tensors(row, *head):
        return inkjet_env.torch.response(row, TIME_S, HeadParameters(*head), period_s=120e-6)

    others = torch.func.jacrev(tensors, argnums=(0, 1, 2, 3, 4))(
        torch.from_numpy(ROWS[0]), *inkjet_env.torch.head_parameters(HEAD)
    )
    for mine, other in zip((by_row, *by_head), others, strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-12)


def test_one_waveform_of_one_head_needs_no_batch():
    for function in (lambda head: peak_cost(ROWS[0], head), lambda head: response(ROWS[0], TIME_S, head).sum()):
        value, by_head = jax.value_and_grad(function)(PARAMETERS)
        np.testing.assert_allclose(by_head.b1 * PARAMETERS.b1, value, rtol=1e-9)


def test_heads_are_mapped():
    factors = np.array([1.0, 1.1])
    costs = jax.vmap(lambda factor: peak_cost(ROWS, PARAMETERS._replace(a0=factor * PARAMETERS.a0)))(factors)
    assert costs.shape == (2, 5)
    np.testing.assert_array_equal(costs[0], batch.costs(ROWS, HEAD))


def test_single_precision_is_the_default_of_jax():
    with jax.enable_x64(False):
        costs = peak_cost(ROWS, HEAD)
    assert costs.dtype == np.float32
    np.testing.assert_allclose(costs, batch.costs(ROWS, HEAD), rtol=1e-4, atol=1e-3)


def test_what_is_no_waveform_is_refused():
    with pytest.raises(ValueError, match=r"waveforms must have shape \(…, 7\)"):
        peak_cost(np.zeros(3), HEAD)
