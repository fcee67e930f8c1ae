"""Anything at all as input: status 0 or 2, one sentence, all written or nothing."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from ambinav.cli import app
from tests.test_bad_input import (
    CALIBRATE,
    FROM_MAP,
    FROM_PLAN,
    HEADER,
    ROOM,
    SCANNER,
    cells,
    check_refusal,
    fill,
    pgm,
    plan,
    polygon,
    sensor,
)


def run_on(files: dict[str, bytes], arguments: tuple[str, ...]) -> Result:
    """Run a command on a folder where some files are replaced; status 0 or 2, all or nothing."""
    with tempfile.TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        patch.chdir(folder)
        fill(folder)
        for path, content in files.items():
            (folder / path).write_bytes(content)
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code in (0, 2), result.output
        assert "Traceback" not in result.output
        if result.exit_code == 2:
            check_refusal(result.stderr, result.stdout, ())
            assert not (folder / "new").exists()
        else:
            made = [path.name for path in (folder / "new").iterdir()]
            assert made == [Path(arguments[arguments.index("-o") + 1]).name]
        return result


FUZZ = settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.too_slow])
# Small ones: a resolution of 40 m would make a map of a square kilometre, and be computed.
scalar = (
    st.none()
    | st.booleans()
    | st.integers(-3, 5)
    | st.floats(-5.0, 5.0)
    | st.sampled_from([float("nan"), float("inf"), 1e308, 1e-320, "", "map.pgm", "../x", "trinary"])
    | st.text(max_size=6)
)
junk = st.recursive(
    scalar,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=6,
)


@st.composite
def spoilt(draw: st.DrawFn, content: bytes) -> bytes:
    """The content with a piece of it replaced by other bytes."""
    start = draw(st.integers(0, len(content)))
    end = draw(st.integers(start, min(len(content), start + 12)))
    return content[:start] + draw(st.binary(max_size=8)) + content[end:]


MAP_TEXT = yaml.safe_dump(HEADER).encode()
PLAN_TEXT = plan(polygon(ROOM)).encode()
SCANNER_TEXT = yaml.safe_dump(SCANNER).encode()


@pytest.mark.slow
@FUZZ
@given(st.binary(max_size=60) | spoilt(MAP_TEXT))
@example(b"")
@example(b"a: &a [*a]")
@example(b"? {}\n: 1")
@example(b"!!python/object/apply:os.getcwd []")
def test_any_bytes_as_a_map(content: bytes) -> None:
    run_on({"map.yaml": content}, FROM_MAP)


@pytest.mark.slow
@FUZZ
@given(st.dictionaries(st.sampled_from([*HEADER, "mode", "x"]), junk, max_size=2))
@example({"resolution": 1e-320})
@example({"resolution": 1e308})
@example({"origin": [1e308, 1e308, 1e308]})
def test_any_values_in_a_map(changes: dict[str, object]) -> None:
    run_on({"map.yaml": yaml.safe_dump(HEADER | changes).encode()}, FROM_MAP)


@pytest.mark.slow
@FUZZ
@given(st.binary(max_size=60) | spoilt(pgm(cells())))
def test_any_bytes_as_an_image(content: bytes) -> None:
    run_on({"map.pgm": content}, FROM_MAP)


@pytest.mark.slow
@FUZZ
@given(st.binary(max_size=60) | spoilt(PLAN_TEXT))
@example(b"[" * 5000)
def test_any_bytes_as_a_plan(content: bytes) -> None:
    run_on({"plan.geojson": content}, FROM_PLAN)


@pytest.mark.slow
@FUZZ
@given(st.lists(st.lists(st.floats(-6.0, 6.0) | scalar, min_size=2, max_size=3), max_size=7))
@example([[0, 0], [1e308, 0], [1e308, 1e308], [0, 1e308], [0, 0]])
@example([[0, 0], [1e-320, 0], [1e-320, 1e-320], [0, 0]])
@example([[0, 0], [1e6, 0], [1e6, 1e6], [0, 1e6], [0, 0]])
def test_any_ring_in_a_plan(ring: list[list[float]]) -> None:
    run_on({"plan.geojson": plan(polygon([*ring, *ring[:1]])).encode()}, FROM_PLAN)


@pytest.mark.slow
@FUZZ
@given(st.binary(max_size=60) | spoilt(SCANNER_TEXT))
def test_any_bytes_as_a_scanner(content: bytes) -> None:
    run_on({"scanner.yaml": content}, FROM_PLAN)


@pytest.mark.sweep
@FUZZ
@given(
    st.dictionaries(
        st.sampled_from(["max_range", "min_range", "std", "bias", "resolution", "aperture_deg"]),
        junk,
        max_size=2,
    )
)
@example({"max_range": 1e308})
@example({"resolution": 1e-320})
@example({"std": 1e308})
def test_any_values_in_a_sensor(changes: dict[str, object]) -> None:
    with tempfile.TemporaryDirectory() as name:
        sensor(**changes)(Path(name))
        content = (Path(name) / "scanner.yaml").read_bytes()
    run_on({"scanner.yaml": content}, FROM_PLAN)


@pytest.mark.slow
@FUZZ
@given(st.binary(max_size=60) | spoilt(b"true_range,reading\n1,1.01\n2,2.01\n3,3.01\n"))
def test_any_bytes_as_pairs(content: bytes) -> None:
    run_on({"pairs.csv": content}, (*CALIBRATE, "0.01"))
