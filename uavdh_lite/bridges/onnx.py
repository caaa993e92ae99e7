"""An agent's network as an ONNX file, to run without torch."""

import json
import warnings
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from uavdh_lite.agent import Agent
from uavdh_lite.environment import ACTIONS
from uavdh_lite.errors import InputError, extra
from uavdh_lite.storage import write_atomically
from uavdh_lite.streams import Use, stream

INPUTS = ("map", "time", "allowed")  # as many as the network takes
TOLERANCE = 1e-3  # of a Q-value, in data units


def export_onnx(agent: Agent, path: str | Path, states: int = 1000) -> float:
    """Write the network that the agent flies by; returns the largest error of its Q-values.

    | input or output | shape | what |
    | --- | --- | --- |
    | `map` | (B, C, W, W) float32 | as `Observation` makes it |
    | `time` | (B, 1) float32 | remaining flying time divided by `time_scale` |
    | `allowed` | (B, 6) bool | the allowed actions, only if the agent has the failsafe |
    | `q_values` | (B, 6) float32 | in the order of `ACTIONS`; −∞ for what is not allowed |

    The file's metadata says how to make the inputs: a JSON with the order of the actions, the side
    of the largest city, and the recipe with its scales.

    ONNX Runtime and the agent are asked about random states under way. If their Q-values differ by
    more than `TOLERANCE`, or are NaN, nothing is written, and `InputError` is raised.
    `MissingExtra` says which of onnx, onnxscript and onnxruntime is not installed.
    """
    with extra("onnx"):
        import onnx
        import onnxruntime
        import onnxscript  # noqa: F401 (torch's exporter needs it)

    generator = stream(Use.EXPORT)
    state = agent.scenario.sample_anywhere(agent.environment, states, generator, spare_time=0)
    inputs = dict(zip(INPUTS, agent.observation(state), strict=False))
    about = {"actions": ACTIONS, "size": agent.observation.size, "recipe": agent.recipe.as_json()}
    model = _model(agent.network, inputs)
    onnx.helper.set_model_props(model, {"uavdh_lite": json.dumps(about)})
    content = model.SerializeToString()

    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    (answered,) = session.run(["q_values"], {name: part.numpy() for name, part in inputs.items()})
    both = answered, agent.q_values(state).numpy()
    answered, expected = (np.maximum(q, -1e9) for q in both)  # −∞ cannot be subtracted
    largest = float(np.abs(answered - expected).max())
    if not largest <= TOLERANCE:  # NaN is not
        raise InputError(f"{path}: not written: ONNX Runtime's Q-values differ by {largest:.2g}")
    write_atomically(path, lambda temporary: temporary.write_bytes(content))
    return largest


def _model(network: nn.Module, inputs: dict[str, Tensor]):
    """The network as an ONNX model for batches of any size."""
    examples = tuple(part[:2] for part in inputs.values())
    batch = torch.export.Dim("batch")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of torch's exporter, about its own parts
        program = torch.onnx.export(
            network.eval(),
            examples,
            input_names=list(inputs),
            output_names=["q_values"],
            dynamic_shapes=tuple({0: batch} for _ in examples),
            dynamo=True,
            verbose=False,
        )
    assert program is not None  # as always with dynamo=True
    return program.model_proto
