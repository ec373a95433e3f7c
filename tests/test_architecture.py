"""What holds the house together: imports go one way, and no file holds more than one can read."""

import ast
from pathlib import Path

import pytest

import pbd_warp as pbd

ROOT = Path(__file__).parent.parent
FOLDERS = {"pbd_warp": ROOT / "pbd_warp", "pbd_warp.kernels": ROOT / "kernels", "pbd_warp.scenes": ROOT / "scenes"}


def modules():
    """Every module by its name; the links inside pbd_warp/ are those two folders."""
    found = {}
    for name, folder in FOLDERS.items():
        for path in folder.rglob("*.py"):
            inner = path.relative_to(folder)
            if name == "pbd_warp" and inner.parts[0] in ("kernels", "scenes"):
                continue
            parts = [name, *inner.with_suffix("").parts]
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(name, tree, known):
    """Modules of ours that a module imports anywhere: at its top, inside functions, for types."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            wanted = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name} imports by a relative name"
            wanted = [f"{node.module}.{alias.name}" for alias in node.names]
            wanted = [full if full in known else node.module for full in wanted]
        else:
            continue
        yield from (full for full in wanted if full in known)


def graph():
    known = modules()
    return {name: set(imports(name, ast.parse(path.read_text()), known)) - {name} for name, path in known.items()}


def cycle(edges):
    """One cycle of a graph, empty where there is none."""
    done, path = set(), []

    def visit(node):
        if node in path:
            return path[path.index(node) :]
        if node in done:
            return []
        path.append(node)
        for other in sorted(edges[node]):
            if found := visit(other):
                return found
        done.add(path.pop())
        return []

    return next((found for node in sorted(edges) if (found := visit(node))), [])


def test_a_cycle_is_found():
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == ["b", "c"]
    assert cycle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_imports_inside_functions_and_for_types_count():
    source = (
        "import typing\nif typing.TYPE_CHECKING:\n    from a import b\ndef f():\n    import c\n    from a.d import e\n"
    )
    assert set(imports("x", ast.parse(source), {"a.b", "c", "a.d"})) == {"a.b", "c", "a.d"}


def test_imports_form_no_cycle():
    assert len(graph()) > 80
    assert cycle(graph()) == []


def test_rooms_form_no_cycle():
    """Scenes apart, which use the public face."""

    def room(module):
        return module.partition("pbd_warp.")[2].split(".")[0]

    apart, rooms = {"", "scenes"}, {}
    for name, others in graph().items():
        if room(name) not in apart:
            rooms.setdefault(room(name), set()).update({room(other) for other in others} - apart - {room(name)})
    assert {"view", "player", "drawing", "step", "model"} <= rooms.keys()
    assert cycle(rooms) == []


def test_dir_shows_what_users_need():
    assert set(dir(pbd)) == set(pbd.__all__)
    assert all(hasattr(pbd, name) for name in pbd.__all__)


def test_kernels_import_nothing_of_ours():
    for name, others in graph().items():
        if name.startswith("pbd_warp.kernels"):
            assert all(other.startswith("pbd_warp.kernels") for other in others), name


def lines(pattern):
    return [(path.name, len(path.read_text().splitlines())) for path in sorted(ROOT.glob(pattern))]


@pytest.mark.parametrize(
    ("pattern", "most"),
    [("pbd_warp/**/*.py", 300), ("kernels/**/*.py", 300), ("scenes/*.py", 300), ("tests/*.py", 450)],
)
def test_no_file_is_too_long_to_be_read(pattern, most):
    assert [each for each in lines(pattern) if each[1] > most] == []


def test_settings_are_written_down_once():
    """Who adds a setting should not have to name it everywhere."""
    naming = [name for name, path in modules().items() if "substeps" in path.read_text()]
    naming = [name for name in naming if not name.startswith(("pbd_warp.scenes", "pbd_warp.kernels"))]
    assert len(naming) <= 14, naming
