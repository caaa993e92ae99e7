"""The how-to guides: every block of code runs, page by page, from top to bottom."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
import torch

from uavdh_lite import recipe, registry
from uavdh_lite.cli.main import main
from uavdh_lite.course.checks import exercise

markdown_it = pytest.importorskip("markdown_it")

pytestmark = pytest.mark.long

DOCS = Path(__file__).parents[2] / "docs"
TEACH = [DOCS / "teach" / name for name in ("class.md", "add_an_exercise.md")]
PAGES = sorted({*(DOCS / "how_to").glob("*.md")} - {DOCS / "how_to" / "index.md"}) + TEACH
COMMAND = ["python", "-m", "uavdh_lite"]
BRIEF = replace(recipe.SMALL, validation_interval=3_200)
BRIEFLY = {"24000": "3200", "24_000": "3_200", "48000": "6400"}  # steps of a training


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_of_a_guide_runs(page, tmp_path, monkeypatch):
    for package in ("gymnasium", "onnxruntime", "psutil", "stable_baselines3", "tensorboard"):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    # Two threads of a training wait for each other where other tests take their core
    monkeypatch.setattr(torch, "set_num_threads", lambda number: None)
    for kind in get_args(registry.Kind):
        registry.names(kind)  # all that registers something is imported
    known = {kind: dict(things) for kind, things in registry._known.items()}
    known["recipe"]["small"] = BRIEF
    monkeypatch.setattr(recipe, "SMALL", BRIEF)
    monkeypatch.setattr(registry, "_known", known)  # guides add a recipe and an exercise
    monkeypatch.setattr(exercise, "EXERCISES", {})
    names = {"__name__": "__main__"}
    text = page.read_text(encoding="utf-8")
    for steps, few in BRIEFLY.items():
        text = text.replace(steps, few)
    for token in markdown_it.MarkdownIt().parse(text):
        if token.type != "fence":
            continue
        line = token.map[0] + 1
        if token.info == "python":
            exec(compile("\n" * line + token.content, str(page), "exec"), names)
        elif token.info == "bash":
            for command in token.content.replace("\\\n", "").splitlines():
                words = shlex.split(command)
                assert words[:3] == COMMAND, f"{page}:{line}: cannot run {command!r}"
                assert main(words[3:]) == 0, f"{page}:{line}: {command}"
        elif token.info != "text" and not token.info.startswith("{generated}"):
            pytest.fail(f"{page}:{line}: a block in {token.info!r} is not run")
