import numpy as np
import pytest

from uavdh_lite.channel import Channel, rate


def test_link_budget_by_hand():
    """A 16×16 city: the edge is at √2 · 160 m / 2 = 113.137 m, 20.5360 dB re 1 m.

    P/σ² = −15 + 2.27 · 20.5360 = 31.6168 dB. A device 30 m away and 10 m below is at √1000 m,
    15 dB re 1 m: LoS 31.6168 − 2.27 · 15 = −2.4332 dB, NLoS 31.6168 − 3.64 · 15 = −22.9832 dB.
    """
    channel = Channel()
    assert channel.transmit_snr_db(16) == pytest.approx(31.6168, abs=1e-4)
    sight = np.array([True, False])
    snr_db = channel.transmit_snr_db(16) - channel.path_loss_db(np.float32([1000, 1000]), sight)
    assert snr_db == pytest.approx([-2.4332, -22.9832], abs=1e-3)
    assert rate(snr_db) == pytest.approx([0.6517, 0.00724], abs=2e-4)  # log2 1.57106, log2 1.00503
    assert rate(np.array([-np.inf, 0])).tolist() == [0, 1]


def test_fading_has_the_given_variance(generator):
    draws = generator.standard_normal(200_000).astype(np.float32)
    assert Channel().fading_db(draws, True).var() == pytest.approx(2, rel=0.02)
    assert Channel().fading_db(draws, False).var() == pytest.approx(5, rel=0.02)
