"""`export`: an agent's network for other programs."""

from pathlib import Path

from uavdh_lite.cli.arguments import open_agent


def export(*, checkpoint: str, city: str | None = None, out: Path = Path("agent.onnx")) -> None:
    """Write an agent's network as an ONNX file.

    The file is written only if ONNX Runtime decides with it as the agent does.

    Arguments:
        checkpoint: a checkpoint file, or the name of a shipped agent.
        city: another city, of the same size or smaller: a PNG, or the name of a shipped one.
        out: the file.
    """
    from uavdh_lite.export import export_onnx

    error = export_onnx(open_agent(checkpoint, city), out)
    print(f"{out}: decides as the agent does; Q-values differ by at most {error:.1g}")
