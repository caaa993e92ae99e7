import torch

from uavdh_lite.beyond.global_local import GlobalLocalNetwork


def test_it_sees_the_map_averaged_and_its_middle_in_full():
    network, seen = GlobalLocalNetwork((5, 9, 9), 2, 5, 2, 3, (1,), (8,)), []
    for layers in network.convolutions:
        layers.register_forward_hook(lambda _, inputs, __: seen.append(inputs[0]))
    map = torch.rand(2, 5, 9, 9)
    assert network(map, torch.rand(2, 1)).shape == (2, 6)
    coarse, middle = seen
    assert coarse.shape == (2, 5, 5, 5)
    assert torch.allclose(coarse[1, 3, 2, 4], map[1, 3, 4:6, 8].sum() / 4)  # half of it is added
    assert torch.allclose(coarse[1, 1, 2, 4], (map[1, 1, 4:6, 8].sum() + 2) / 4)
    assert torch.allclose(coarse[1, 3, 2, 1], map[1, 3, 4:6, 2:4].mean())
    assert torch.equal(middle, map[:, :, 2:7, 2:7])
