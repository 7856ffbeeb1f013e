"""Every command and code block of README and docs is run, or, where it can't be here, checked."""

from __future__ import annotations

import ast
import contextlib
import fcntl
import importlib.util
import os
import re
import shlex
import shutil
import tomllib
from pathlib import Path

import click
import pytest
import yaml

from tests.docs.blocks import MARKS, PAGES, REPO, Block, blocks, commands, run
from vrbench.cli import cli
from vrbench.config.case import Cue
from vrbench.config.recordings import Source, load_recordings
from vrbench.config.rig import load_rig
from vrbench.config.suite import load_suite
from vrbench.config.yaml_file import validate
from vrbench.plugin.manager import Plugins, check_options, families_of

TUTORIAL = REPO / "docs" / "tutorial.md"
LANGUAGES = {"console", "yaml", "python", "text", "toml"}
EVERY = [block for page in PAGES for block in blocks(page)]
CONSOLE = [block for block in EVERY if block.language == "console"]


@pytest.fixture(scope="session")
def after_tutorial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that the tutorial leaves behind: followed once, whichever worker comes first."""
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "tutorial"
    shared.mkdir(exist_ok=True)
    with (shared / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / "followed").exists():
            (shared / "folder").mkdir()
            follow(blocks(TUTORIAL), shared / "folder")
            (shared / "followed").touch()
    return shared / "folder"


def follow(page: list[Block], folder: Path) -> None:
    """Does what a page says: writes its named files, runs its commands and its Python."""
    for block in page:
        if name := file_name(block):
            (folder / name).write_text(block.text, encoding="utf-8")
        elif block.language == "console" and not block.skipped:
            run(block, folder)
        elif block.language == "python" and not block.skipped:
            with contextlib.chdir(folder):
                names = {"__name__": block.place, "__file__": str(folder / "tests" / "block.py")}
                exec(compile(block.text, block.place, "exec"), names)


def file_name(block: Block) -> str | None:
    """The name in a first line like `# my-lab.yaml`."""
    named = re.match(r"# ([\w.-]+\.yaml)\b", block.text)
    return named[1] if named and block.language == "yaml" else None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPO)))
def test_a_page_can_be_followed(page: Path, tmp_path: Path, after_tutorial: Path) -> None:
    if page == TUTORIAL:
        assert (after_tutorial / "runs").is_dir()
        return
    found = blocks(page)
    if any("tutorial" in block.marks for block in found):
        shutil.copytree(after_tutorial, tmp_path, dirs_exist_ok=True)
    follow(found, tmp_path)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPO)))
def test_links_and_pictures_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("block", EVERY, ids=lambda block: block.place)
def test_a_block_says_what_it_is(block: Block) -> None:
    assert block.language in LANGUAGES, "begin the fence with what the block is"
    assert all(mark in MARKS or mark.startswith("exit=") for mark in block.marks)
    if block.language == "text":
        found = re.search(r"^(\$ |vrbench [a-z])", block.text, re.M)
        assert not found, "commands belong into a console block"
    if block.language == "toml":
        assert tomllib.loads(block.text)


@pytest.mark.parametrize("block", CONSOLE, ids=lambda block: block.place)
def test_verbs_and_options_of_commands_exist(block: Block) -> None:
    said = commands(block)
    assert said
    for command in said:
        for words in simple_commands(command.text):
            if words[0] == "vrbench":
                parse(words[1:])
            elif words[0] == "make":
                made = (REPO / "Makefile").read_text()
                assert all(f"\n{target}:" in made for target in words[1:])
            elif words[0].startswith("python") and len(words) > 1 and words[1].endswith(".py"):
                assert (REPO / words[1]).is_file()
            elif words[0].startswith("python") and words[1:2] == ["-m"]:
                assert importlib.util.find_spec(words[2]), f"no module {words[2]}"


@pytest.mark.parametrize(
    "block",
    [b for b in EVERY if b.language == "python" and b.skipped],
    ids=lambda block: block.place,
)
def test_python_that_is_not_run_is_python_and_what_it_imports_is_there(block: Block) -> None:
    tree = ast.parse(block.text)
    imports = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    assert imports
    exec(compile(ast.Module(imports, []), block.place, "exec"), {})


def simple_commands(text: str) -> list[list[str]]:
    """The words of each command of a line of shell, without comments and here-documents."""
    lexer = shlex.shlex(text.split("\n")[0] if "<<" in text else text, punctuation_chars=True)
    lexer.whitespace_split = True
    found: list[list[str]] = [[]]
    for word in lexer:
        if set(word) <= set("|;&"):
            found.append([])
        else:
            found[-1].append(word.strip("'\""))
    return [words for words in found if words]


def parse(words: list[str]) -> None:
    """Finds the verb, and parses its options as click does; nothing is run."""
    command: click.Command = cli
    context = click.Context(command)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        found = command.get_command(context, words[0])
        assert found is not None, f"no verb {words[0]}"
        command, words = found, words[1:]
        context = click.Context(command, parent=context)
    given, _, _ = command.make_parser(context).parse_args(list(words))
    for parameter in command.params:
        if isinstance(parameter.type, click.Choice) and isinstance(given.get(parameter.name), str):
            parameter.type.convert(given[parameter.name], parameter, context)


def test_demo_blocks_are_what_make_demo_runs() -> None:
    made = (REPO / "Makefile").read_text().replace("$(BIN)/", "").replace("$(RUNS)/", "")
    demo = [command for b in CONSOLE if "demo" in b.marks for command in commands(b)]
    assert demo
    for command in demo:
        assert f"\t{command.text}\n" in made


@pytest.mark.parametrize(
    "block", [b for b in EVERY if b.language == "yaml"], ids=lambda block: block.place
)
def test_yaml_is_what_vrbench_reads(block: Block, tmp_path: Path) -> None:
    content = yaml.safe_load(block.text)
    path = tmp_path / (file_name(block) or "block.yaml")
    for other in blocks(block.page):
        if name := file_name(other):
            (tmp_path / name).write_text(other.text, encoding="utf-8")
    path.write_text(block.text, encoding="utf-8")
    plugins = Plugins()
    if "takes" in content:
        assert load_recordings(path).takes
    elif "suite" in content:
        text = re.sub(r"motions/\S+\.tum", "shooter-1", block.text)
        path.write_text(text, encoding="utf-8")
        suite = load_suite(str(path), dict(plugins.suites))
        assert families_of(suite, plugins, str(path))
    elif any("plugin" in content.get(device, {}) for device in ("headset", "mocap", "robot")):
        # a README may show a part of a rig
        rest = {"lab": "lab: x\n", "headset": "headset: {plugin: sim}\n"}
        lacking = "".join(line for field, line in rest.items() if field not in content)
        path.write_text(lacking + block.text, encoding="utf-8")
        rig = load_rig(str(path))
        for choice, known in (
            (rig.headset, plugins.headsets),
            (rig.mocap, plugins.mocap),
            (rig.robot, plugins.robots),
        ):
            if choice is not None:
                spec = known[choice.plugin]
                check_options(choice.options, spec.options, field="options", file=str(path))
    elif "events" in content:
        assert [validate(event, Cue, path) for event in content["events"]]
    elif any("format" in stream for stream in content.values() if isinstance(stream, dict)):
        for stream in content.values():
            source = validate(stream, Source, path)
            plugins.importers[source.format].options.model_validate(source.options)
    else:
        assert "jobs" in content or "table_m" in content, "of no kind that vrbench reads"
