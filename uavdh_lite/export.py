"""An agent's network as an ONNX file, to run without torch."""

import json
import warnings
from pathlib import Path

import numpy as np
import torch

from uavdh_lite.agent import Agent
from uavdh_lite.city import one_city
from uavdh_lite.environment import ACTIONS
from uavdh_lite.errors import InputError, extra
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import write_atomically
from uavdh_lite.streams import Use, stream

TOLERANCE = 1e-3  # of a Q-value, in data units


def export_onnx(agent: Agent, path: str | Path, states: int = 1000) -> float:
    """Write the network, and check that it decides as the agent does; returns the largest error.

    | input or output | shape | what |
    | --- | --- | --- |
    | `map`, or `global_map` and `local_map` | (B, C, rows, columns) float32 | as `Observation` makes them |
    | `time` | (B, 1) float32 | remaining flying time divided by the recipe's `time_scale` |
    | `q_values` | (B, 6) float32 | in the order of `ACTIONS` |

    The file's metadata has the order of the actions, the scales, the city and the scenario as JSON.
    If it says `failsafe`, choose only among the actions after which a landing is still possible.
    ONNX Runtime and the agent are asked about random states under way. Their Q-values may differ by
    at most `TOLERANCE`, and they must choose the same action wherever the best two Q-values differ
    by more; otherwise nothing is written.

    Raises `MissingExtra` without onnx, onnxscript or onnxruntime; `InputError` if the two disagree.
    """  # noqa: E501
    with extra("onnx"):
        import onnx
        import onnxruntime
        import onnxscript  # noqa: F401 (torch's exporter needs it)

    generator = stream(Use.EXPORT)
    sampled = agent.scenario.sample_anywhere(agent.city, states, generator, spare_time=0)
    with torch.no_grad():
        maps, time = agent.observation(sampled)
    names = ["map"] if len(maps) == 1 else ["global_map", "local_map"]
    batch = torch.export.Dim("batch")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of torch's exporter, about its own parts
        program = torch.onnx.export(
            agent.network.eval(),
            ([layers[:2] for layers in maps], time[:2]),
            input_names=[*names, "time"],
            output_names=["q_values"],
            dynamic_shapes=([{0: batch}] * len(maps), {0: batch}),
            dynamo=True,
            verbose=False,
        )
    assert program is not None  # as always with dynamo=True
    model = program.model_proto
    onnx.helper.set_model_props(model, {"uavdh_lite": json.dumps(_about(agent))})

    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    inputs = {name: layers.numpy() for name, layers in zip(names, maps, strict=True)}
    (answered,) = session.run(["q_values"], {**inputs, "time": time.numpy()})
    expected = agent.q_values(sampled).numpy()
    largest = float(np.abs(answered - expected).max())
    best_two = np.sort(expected, axis=1)[:, -2:]
    clear = best_two[:, 1] - best_two[:, 0] > TOLERANCE
    agree = answered.argmax(1) == expected.argmax(1)
    if largest > TOLERANCE or not agree[clear].all():
        raise InputError(
            f"{path}: not written, ONNX Runtime decides otherwise in {(~agree).sum()} of {states} "
            f"states; Q-values differ by up to {largest:.2g}"
        )
    write_atomically(path, lambda temporary: temporary.write_bytes(model.SerializeToString()))
    return largest


def _about(agent: Agent) -> dict:
    scenario: Scenario = agent.scenario
    return {
        "actions": ACTIONS,
        "failsafe": agent.recipe.failsafe,
        "observation": agent.recipe.observation,
        "data_scale": agent.recipe.data_scale,
        "time_scale": agent.recipe.time_scale,
        "city": {"name": agent.city.name, "rows": one_city(agent.city).text.split()},
        "scenario": scenario.name,
    }
