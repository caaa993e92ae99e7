"""QR-DQN: the loss, the targets, and what they learn."""

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.errors import InputError
from uavdh_lite.quantile import QRDQN, QuantileNetwork, midpoints, quantile_huber_loss
from uavdh_lite.recipe import QUANTILE
from uavdh_lite.training import Trainer


def test_midpoints_by_hand():
    assert midpoints(4).tolist() == [0.125, 0.375, 0.625, 0.875]
    assert midpoints(1).tolist() == [0.5]


@pytest.mark.parametrize(
    ("samples", "kappa", "loss"),
    [
        ([3.0], 1.0, 1.75),  # u = 3, 2: L = 2.5, 1.5; weights 0.25, 0.75
        ([-1.0], 1.0, 0.75),  # u = −1, −2: L = 0.5, 1.5; weights 0.75, 0.25
        ([3.0, -1.0], 1.0, 1.25),  # the mean of both
        ([3.0], 2.0, 2.5),  # L = 2 (3 − 1) = 4, and 2² / 2 = 2
        ([0.0], 1.0, 0.125),  # u = 0, −1: L = 0, 0.5; weights 0.25, 0.25
    ],
)
def test_loss_by_hand(samples, kappa, loss):
    """Two quantiles, at 0 and 1, of levels 1/4 and 3/4."""
    quantiles = torch.tensor([[0.0, 1.0]])
    assert float(quantile_huber_loss(quantiles, torch.tensor([samples]), kappa)) == loss


def slow_loss(quantiles, samples, kappa):
    """One pair after the other, as the paper writes it."""
    total = 0.0
    for own, drawn in zip(quantiles, samples, strict=True):
        for i, theta in enumerate(own):
            level = (2 * i + 1) / (2 * len(own))
            for y in drawn:
                u = y - theta
                huber = u**2 / 2 if abs(u) <= kappa else kappa * (abs(u) - kappa / 2)
                total += abs(level - (u < 0)) * huber / len(drawn)
    return total / len(quantiles)


@pytest.mark.parametrize("kappa", [0.1, 1.0, 7.0])
@pytest.mark.parametrize(("batch", "count", "drawn"), [(1, 1, 1), (5, 3, 4), (3, 8, 8), (4, 2, 1)])
def test_loss_is_that_of_a_slow_loop(kappa, batch, count, drawn, generator):
    quantiles = generator.normal(0, 5, (batch, count))
    samples = generator.normal(1, 5, (batch, drawn))
    loss = quantile_huber_loss(torch.tensor(quantiles), torch.tensor(samples), kappa)
    assert float(loss) == pytest.approx(slow_loss(quantiles, samples, kappa), rel=1e-5)


def normal_quantile(level):
    return 10 + 3 * NormalDist().inv_cdf(level)


def two_peaks_quantile(level):
    """A landing that pays 40 in 30 of 100 cases, and else 0 to 7, evenly."""
    return 10 * level if level < 0.7 else 40.0


@pytest.mark.long
@pytest.mark.parametrize("quantile", [normal_quantile, two_peaks_quantile])
def test_quantile_regression_learns_a_known_distribution(quantile, generator):
    """Samples alone, and the loss leads to the quantiles of what they are drawn from."""
    learned = nn.Parameter(torch.zeros(1, 7))
    optimiser = torch.optim.Adam([learned], 0.5)
    rate = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.0, 2000)
    for _ in range(2000):
        samples = [quantile(level) for level in generator.random(64)]
        loss = quantile_huber_loss(learned, torch.tensor([samples]), kappa=0.01)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        rate.step()
    expected = [quantile(level) for level in midpoints(7).tolist()]
    assert learned[0].tolist() == pytest.approx(expected, abs=0.4)


def network(quantiles=4):
    torch.manual_seed(0)
    return QuantileNetwork([(5, 9, 9)], 4, 3, (2,), (16,), quantiles=quantiles)


def test_the_q_value_is_the_mean_of_the_quantiles():
    maps, time = [torch.rand(3, 5, 9, 9)], torch.rand(3, 1)
    one = network()
    quantiles = one.quantiles(maps, time)
    assert quantiles.shape == (3, 6, 4)
    assert torch.equal(one(maps, time), quantiles.mean(dim=2))
    assert one(maps, time).shape == (3, 6)


class Table(nn.Module):
    """Quantiles by state number, [state, action, quantile], in place of a network."""

    def __init__(self, values):
        super().__init__()
        self.values = nn.Parameter(torch.tensor(values))

    def quantiles(self, state):
        return self.values[state]

    def forward(self, state):
        return self.quantiles(state).mean(dim=2)


def learner():
    """By its mean the online network likes action 0 best, by one quantile action 1; the target
    network likes action 2."""
    online = [[[3.0, 4.0], [0.0, 6.0], [1.0, 1.0]]]
    own = QRDQN(Table(online), None, 0.5, 1.0)
    own.target.values.data = torch.tensor([[[5.0, 7.0], [-1.0, 2.0], [90.0, 95.0]]])
    return own


def test_the_online_mean_chooses_and_the_target_network_gives_the_quantiles():
    reward, discount = torch.tensor([1.0, 2.0]), torch.tensor([0.5, 0.0])
    y = learner().targets(reward, discount, (torch.tensor([0, 0]),))
    assert y.tolist() == [[3.5, 4.5], [2.0, 2.0]]  # 1 + 5/2, 1 + 7/2; and the end


def test_the_choice_is_among_the_allowed_actions():
    allowed = torch.tensor([[False, True, True]])
    y = learner().targets(torch.zeros(1), torch.ones(1), (torch.tensor([0]),), allowed)
    assert y.tolist() == [[-1.0, 2.0]]


def test_an_update_moves_only_the_action_taken():
    """One state, θ = (0, 1) of action 1, one sample at 3: the slopes are 1/4 · 1 and 3/4 · 1."""
    own = QRDQN(Table([[[0.0, 1.0]] * 3]), None, 0.5, 1.0)
    own.optimiser = torch.optim.SGD(own.online.parameters(), 0.4)
    loss = own.update((torch.tensor([0]),), torch.tensor([1]), torch.tensor([[3.0]]))
    assert float(loss) == 1.75
    after = [[0.0, 1.0], [0.1, 1.3], [0.0, 1.0]]
    assert torch.allclose(own.online.values[0], torch.tensor(after))
    assert torch.allclose(own.target.values[0, 1], torch.tensor([0.05, 1.15]))


def test_quantiles_need_a_kappa():
    with pytest.raises(InputError, match="huber_delta is None, must be a number with quantiles"):
        replace(QUANTILE, huber_delta=None)


def test_agents_with_quantiles_have_q_values_as_others(corridor, corridor_scenario, quick):
    trainer = Trainer(corridor_scenario, replace(quick, quantiles=5), 0, corridor)
    q_values = trainer.agent.q_values(trainer.state)
    assert q_values.shape == (16, 6)
    with torch.no_grad():
        quantiles = trainer.learner.online.quantiles(*trainer.observation(trainer.state))
    assert quantiles.shape == (16, 6, 5)
    assert np.allclose(q_values, quantiles.mean(2), atol=1e-6)
