"""The networks' page says what the networks are, and its worked example is right."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import treereg_bn_landmarks.network
import treereg_bn_rows.counts
import treereg_bn_rows.network

from benchmarks.network_pictures import LAYOUTS, picture
from benchmarks.networks import EXAMPLE, PAGE, Known, contents, example, networks, table
from benchmarks.pages import filled
from treereg_core.network import Network, Node


def test_the_page_is_what_the_command_makes() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert filled(page, contents()) == page, "make it again: uv run python -m benchmarks.networks"
    with pytest.raises(ValueError, match="lacks the marks"):
        filled(page.replace("<!-- /bn_rows -->", ""), contents())


def test_the_tables_are_those_that_the_methods_start_from() -> None:
    shown = networks()
    for node, probabilities in treereg_bn_landmarks.network.together(treereg_bn_landmarks.network.none()).items():
        assert shown["bn_landmarks"].probabilities(node) == pytest.approx(probabilities)
    model = treereg_bn_rows.network.network(treereg_bn_rows.counts.mixed({}))
    for node in shown["bn_rows"].counts:
        table = np.moveaxis(model.get_cpds(node).values, 0, -1)
        assert shown["bn_rows"].probabilities(node) == pytest.approx(table)
    for known in shown.values():
        assert {node.name for node in known.network.nodes} - known.counts.keys() <= {"same"}


def test_the_worked_example_is_what_the_network_says() -> None:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`pgmpy\.estimators\.StructureScore` is deprecated", FutureWarning)
        from pgmpy.inference import VariableElimination
    inference = VariableElimination(treereg_bn_rows.network.network(treereg_bn_rows.counts.prior()))
    answer = inference.query(["same"], EXAMPLE, show_progress=False).get_value(same="yes")
    stated = re.search(r"= (\d+) %\.$", example(networks()["bn_rows"], EXAMPLE))
    assert stated is not None
    assert float(stated[1]) == pytest.approx(100 * answer, abs=0.5)


def test_a_table_has_its_parents_states_first() -> None:
    grass = Node("grass", "how the grass is", ("dry", "wet"), ("rain",))
    known = Known(
        Network((Node("rain", "whether it rains", ("no", "yes")), grass)), {"grass": np.array([[3, 1], [0, 9]])}
    )
    assert table(known, grass)[2:] == ["| no | 75.0 | 25.0 | 4 |", "| yes | 0 | 100.0 | 9 |"]


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_node_is_in_the_picture(name: str, tmp_path: Path) -> None:
    network = networks()[name].network
    assert LAYOUTS[name].places.keys() == {node.name for node in network.nodes}
    assert LAYOUTS[name].bends.keys() <= {(parent, node.name) for node in network.nodes for parent in node.parents}
    picture(network, LAYOUTS[name], tmp_path / "picture.png")
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
    assert (PAGE.parent / "img" / f"{name}.png").exists()
