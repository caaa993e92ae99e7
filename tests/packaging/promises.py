"""What an installation promises, tried by its own Python: `python promises.py NAME`."""

import ast
import contextlib
import importlib
import io
import json
import pkgutil
import re
import runpy
import sys
from pathlib import Path
from urllib.request import urlopen

import uavdh_lite
from uavdh_lite.cli.main import main
from uavdh_lite.errors import MissingExtra

ROOT = Path(__file__).parents[2]
ENVIRONMENT = "uavdh_lite/DataHarvesting-v0"
LABS = "canvas channel city fly gallery menu mission stage think training views widgets"
NEEDS = {  # modules that need an extra
    **{f"uavdh_lite.labs.{name}": "notebooks" for name in LABS.split()},
    "uavdh_lite.course.quiz": "notebooks",
    "uavdh_lite.course.challenge.board": "classroom",
    "uavdh_lite.course.challenge.referee": "classroom",
    "uavdh_lite.labs.app.server": "app",
    "uavdh_lite.gym": "gym",
}
TINY = "--steps 5120 --environments 32 --kernels 2 --hidden 8 --batch-size 32 --replay-prefill 320 \
--replay-capacity 1000 --validation-interval 5120 --validation-episodes 5"
TRAIN = f"train --scenario village --recipe small {TINY}"
STUDY = f"ablation --scenario village --recipe small --variants centred --seeds 1 {TINY}"


def core():
    modules()
    works("demo --episodes 5")
    works("evaluate --checkpoint manhattan --episodes 5 --json metrics.json")
    works("compare --episodes 1")
    works("fly --save-mission mission.json --out flight.png")
    works("fly --mission mission.json --out flight.pdf")
    works("city harbour")
    works(TRAIN)
    works(STUDY)
    refused("export --checkpoint manhattan", "onnx")
    refused("challenge new secret.json", "classroom")
    refused(f"{STUDY} --backend dask --out other", "dask")
    refused(f"{TRAIN} --tensorboard --out other", "tensorboard")
    refused("app --no-browser", "app")


def bootstrap():
    """What the notebooks' first cell installs is enough for all but those on labs and Gymnasium."""
    import ipywidgets
    from matplotlib.figure import Figure

    from uavdh_lite.course.quiz import Quiz, questions
    from uavdh_lite.labs.widgets import explore

    for name in questions():
        quiz = Quiz(name)
        quiz.choices.value = quiz.question.choices[0]
        assert quiz.answer.value and "<details>" in quiz._repr_mimebundle_()["text/html"]
    slider = ipywidgets.IntSlider(value=2, min=1, max=9)
    *_, message, picture = explore(lambda width: Figure(figsize=(width, 2)), width=slider).children
    before, slider.value = picture.value, 3
    assert picture.value != before and bytes(picture.value[1:4]) == b"PNG" and not message.value
    try:
        from uavdh_lite.labs import MissionLab  # noqa: F401
    except MissingExtra as error:
        assert str(error) == "anywidget is not installed: pip install 'uavdh-lite[notebooks]'"
    else:
        raise AssertionError("this installation has more than it says")
    for statement in sorted(set(notebook_imports("0*.ipynb"))):
        exec(statement)


def notebook_imports(pattern):
    """The import statements of tutorials, exercises and solutions."""
    for path in (ROOT / "notebooks").rglob(pattern):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        for cell in (cell for cell in cells if cell["cell_type"] == "code"):
            source = re.sub(r"(?m)^(\s*)[%!].*", r"\1pass", "".join(cell["source"]))
            for node in ast.walk(ast.parse(source)):
                if isinstance(node, ast.Import | ast.ImportFrom):
                    yield ast.unparse(node)


def app():
    modules("app", "notebooks")
    sys.path.insert(0, str(ROOT / "tests" / "browser"))
    from serving import serving

    with serving() as (address, server):
        page = urlopen(address, timeout=60).read()
    assert server.returncode == 0
    assert b"application/vnd.jupyter.widget-view+json" in page and b"Traceback" not in page


def classroom():
    modules("classroom", "notebooks")
    works("challenge new secret.json --episodes 5")
    policy = "import numpy\ndef policy(environment, state):\n    return numpy.full(len(state), 4)\n"
    Path("hover.py").write_text(policy)
    works("challenge score greedy hover.py --secret secret.json --leaderboard board.json")
    works("challenge show board.json")
    assert json.loads(Path("board.json").read_text())["scores"].keys() == {"greedy", "hover"}
    from nbgrader.apps import NbGraderApp

    assert NbGraderApp.subcommands["autograde"]


def dask():
    works(f"{STUDY} --backend dask")


def docs():
    modules("app", "classroom", "gym", "notebooks")
    conf = runpy.run_path(str(ROOT / "docs" / "conf.py"))
    for name in (*conf["extensions"], conf["html_theme"]):
        importlib.import_module(name)


def gym():
    modules("gym")
    import gymnasium
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make(
        "uavdh_lite/DataHarvesting-v0", scenario="village", render_mode="rgb_array"
    )
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=0)
    env.step(0)
    assert env.render().shape[2] == 3
    many = gymnasium.make_vec(
        "uavdh_lite/DataHarvesting-v0", 3, vectorization_mode="vector_entry_point"
    )
    many.reset(seed=0)
    assert len(many.step(many.action_space.sample())[1]) == 3


def sb3():
    modules("gym")
    import gymnasium
    from stable_baselines3 import DQN

    env = gymnasium.make(ENVIRONMENT, scenario="village")
    model = DQN("MultiInputPolicy", env, learning_starts=8, buffer_size=100, batch_size=8)
    assert model.learn(24).num_timesteps == 24


def onnx():
    works("export --checkpoint manhattan --out agent.onnx")
    import onnxruntime

    assert onnxruntime.InferenceSession("agent.onnx").get_outputs()[0].name == "q_values"


def tensorboard():
    works(f"{TRAIN} --tensorboard --out run")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator("run/tensorboard")
    events.Reload()
    assert "validation/collection_ratio_and_landed" in events.Tags()["scalars"]


def notebooks():
    modules("notebooks")
    import jupytext
    from nbclient import NotebookClient

    script = (
        "# %%\nfrom uavdh_lite.labs import Labs\n\nlabs = Labs()\nlabs.selected_index = 5\nlabs\n"
    )
    notebook = jupytext.reads(script, fmt="py:percent")
    notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3"}
    NotebookClient(notebook, timeout=120).execute()
    (output,) = notebook.cells[0].outputs
    assert "application/vnd.jupyter.widget-view+json" in output["data"]


def modules(*provided):
    """Every module can be imported, unless it needs an extra: then it says which."""
    for module in pkgutil.walk_packages(uavdh_lite.__path__, "uavdh_lite."):
        needed = NEEDS.get(module.name)
        if module.name == "uavdh_lite.__main__":
            continue
        try:
            importlib.import_module(module.name)
        except MissingExtra as error:
            assert needed not in (None, *provided), (module.name, error)
            assert str(error).endswith(f" is not installed: pip install 'uavdh-lite[{needed}]'")
        else:
            assert needed is None or provided, f"{module.name} needs no extra, but NEEDS has it"


def works(arguments):
    status, printed = command(arguments)
    assert status == 0, printed


def refused(arguments, extra):
    """The command says in one line what to install."""
    status, printed = command(arguments)
    hint = f" is not installed: pip install 'uavdh-lite[{extra}]'\n"
    assert status == 2 and printed.count("\n") == 1 and printed.endswith(hint), printed
    assert printed.startswith("uavdh_lite: error: ")


def command(arguments):
    """Status of a command, and what it prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        status = main(arguments.split())
    return status, printed.getvalue()


if __name__ == "__main__":
    assert not Path(uavdh_lite.__file__).is_relative_to(ROOT)  # what is tried is what was installed
    globals()[sys.argv[1]]()
