"""The printhead as functions of PyTorch."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="inkjet_env.torch needs PyTorch, the extra rl")

from inkjet_env.printhead import Bounds, PeakCost, Printhead, batch  # noqa: E402
from inkjet_env.torch import HeadParameters, head_parameters, peak_cost, response  # noqa: E402

HEAD = Printhead.published()
TIME_S = np.linspace(0, 150e-6, 11)
LOWER, HALF_WIDTH = torch.tensor(Bounds().lower, dtype=torch.float64), torch.from_numpy(Bounds().half_width)


def points(*shape, seed=0):
    """Points of the unit box, where every coordinate has the same scale."""
    return torch.from_numpy(np.random.default_rng(seed).uniform(-0.95, 0.95, (*shape, 7)))


def waveforms(*shape, seed=0):
    return LOWER + (points(*shape, seed=seed) + 1) * HALF_WIDTH


def relative(*factors):
    """The published head with its parameters multiplied, so that every factor has the same scale."""
    return HeadParameters(*(factor * value for factor, value in zip(factors, head_parameters(HEAD), strict=True)))


def ones():
    return [torch.ones_like(value).requires_grad_() for value in head_parameters(HEAD)]


def test_the_cost_is_that_of_the_simulator():
    rows = waveforms(30)
    np.testing.assert_array_equal(peak_cost(rows, HEAD).numpy(), batch.costs(rows.numpy(), HEAD))
    cost = PeakCost(-4, 2, "first")
    np.testing.assert_array_equal(
        peak_cost(rows, HEAD, cost, period_s=120e-6).numpy(), batch.costs(rows.numpy(), HEAD, cost, period_s=120e-6)
    )


@pytest.mark.parametrize("settings", [{}, {"period_s": 120e-6}])
def test_gradcheck_of_the_cost_in_waveform_and_head(settings):
    def cost(points, *factors):
        return peak_cost(LOWER + (points + 1) * HALF_WIDTH, relative(*factors), **settings)

    inputs = (points(4, seed=1).requires_grad_(), *ones())
    assert torch.autograd.gradcheck(
        cost, inputs, eps=1e-7, atol=1e-4, rtol=1e-4, check_forward_ad=True, check_batched_grad=True
    )


@pytest.mark.parametrize("settings", [{}, {"period_s": 120e-6, "earlier_drops": 2}])
def test_gradcheck_of_the_response_in_waveform_and_head(settings):
    def signal(points, *factors):
        return response(LOWER + (points + 1) * HALF_WIDTH, TIME_S, relative(*factors), **settings)

    inputs = (points(2, seed=2).requires_grad_(), *ones())
    assert torch.autograd.gradcheck(signal, inputs, eps=1e-6, atol=1e-5, rtol=1e-5)


def test_vmap_and_grad_of_functions():
    rows = waveforms(6)
    mapped = torch.func.vmap(torch.func.grad(lambda row: peak_cost(row, HEAD)))(rows)
    np.testing.assert_array_equal(mapped.numpy(), batch.costs_and_gradients(rows.numpy(), HEAD)[1])
    heads = head_parameters(HEAD)
    factors = torch.tensor([0.9, 1.0, 1.1], dtype=torch.float64)
    costs = torch.func.vmap(lambda factor: peak_cost(rows, heads._replace(a0=factor * heads.a0)))(factors)
    assert costs.shape == (3, 6)
    np.testing.assert_array_equal(costs[1].numpy(), peak_cost(rows, HEAD).numpy())
    jacobian = torch.func.jacrev(lambda a1: response(rows, TIME_S, heads._replace(a1=a1)))(heads.a1)
    step = 1e-5 * heads.a1
    up, down = (response(rows, TIME_S, heads._replace(a1=heads.a1 + sign * step)) for sign in (1, -1))
    np.testing.assert_allclose(jacobian * heads.a1, (up - down) / 2e-5, rtol=1e-6, atol=1e-7)


def test_shapes_broadcast_and_gradients_have_the_shape_of_their_inputs():
    rows = waveforms(4, 1).requires_grad_()
    heads = HeadParameters(*(value.detach().requires_grad_() for value in head_parameters(HEAD)))
    many = heads._replace(b1=heads.b1 * torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64))
    costs = peak_cost(rows, many)
    assert costs.shape == (4, 3)
    costs.sum().backward()
    assert rows.grad.shape == (4, 1, 7)
    assert heads.b1.grad.shape == ()
    assert heads.coefficients.grad.shape == (8,)
    np.testing.assert_allclose((heads.b1.grad * heads.b1).detach(), costs.detach().sum(), rtol=1e-12)


def test_one_waveform_of_one_head_needs_no_batch():
    heads = HeadParameters(*(value.requires_grad_() for value in head_parameters(HEAD)))
    row = waveforms(1)[0].requires_grad_()
    for value in (peak_cost(row, heads), response(row, TIME_S, heads).sum()):
        assert value.shape == ()
        (by_b1,) = torch.autograd.grad(value, heads.b1)
        assert (by_b1 * heads.b1).item() == pytest.approx(value.item(), rel=1e-9)


def test_single_precision_in_gives_single_precision_out():
    rows = waveforms(3).float().requires_grad_()
    costs = peak_cost(rows, HEAD)
    costs.sum().backward()
    assert costs.dtype == rows.grad.dtype == torch.float32
    np.testing.assert_array_equal(
        costs.detach().numpy(), batch.costs(rows.detach().double().numpy(), HEAD).astype(np.float32)
    )


def test_second_derivatives_are_refused():
    rows = waveforms(2).requires_grad_()
    for value in (peak_cost(rows, HEAD), response(rows, TIME_S, HEAD)):
        (gradient,) = torch.autograd.grad(value.sum(), rows, create_graph=True)
        with pytest.raises(NotImplementedError, match="second derivatives of the printhead are not available"):
            gradient.sum().backward()


def test_what_is_no_waveform_is_refused():
    with pytest.raises(ValueError, match=r"waveforms must have shape \(…, 7\)"):
        peak_cost(torch.zeros(3), HEAD)
    with pytest.raises(ValueError, match="finite"):
        peak_cost(torch.full((7,), torch.nan), HEAD)


def test_descents_from_many_starts_reach_nearly_the_best_cost():
    """Adam on 256 noisy points, a hundred steps: within a tenth of the best known −22.83 V."""
    generator = torch.Generator().manual_seed(1)
    point = (2 * torch.rand(256, 7, dtype=torch.float64, generator=generator) - 1).requires_grad_()
    search, best_V = torch.optim.Adam([point], lr=0.05), 0.0
    for step in range(100):
        noise = 0.05 * (1 - step / 100) * torch.randn(point.shape, dtype=torch.float64, generator=generator)
        costs = peak_cost(LOWER + ((point + noise).clamp(-1, 1) + 1) * HALF_WIDTH, HEAD)
        search.zero_grad()
        costs.sum().backward()
        search.step()
        with torch.no_grad():
            point.clamp_(-1, 1)
        best_V = min(best_V, costs.min().item())
    assert best_V < 0.9 * -22.83
