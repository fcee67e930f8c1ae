"""The store of maps: opened where it was built before, and never anything else than built."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import ambinav as an
from ambinav.layers.registry import LAYERS, Layer
from ambinav.sensing.scanner import RangeScanner
from ambinav.store import build_lock, entry, map_store, upkeep
from ambinav.store.map_store import MapStore
from ambinav.store.settings import LIMIT
from tests.maps import synthetic
from tests.store.scenes import build, laser, names, python, room, same

SMALL = 1_000_000
"""A limit of which each map is so large a part that the folder is looked through."""


def the_map(store: MapStore) -> Path:
    (path,) = store.place.glob("*.map")
    return path


# -- what is opened ------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"headings": 4}, {"layers": "fisher"}])
def test_what_was_built_is_opened(store, computes, options) -> None:
    built = build(store, **options)
    shares: list[float] = []
    opened = build(store, **options, progress=shares.append)
    assert len(computes) == 1 and shares == [1.0]
    assert opened.dataset.identical(built.dataset)  # when and by what it was made among it
    plain = build(False, **options)
    assert len(computes) == 2 and same(plain, opened)
    assert plain.source == opened.source
    assert opened.environment.free.equals(built.environment.free)
    np.testing.assert_array_equal(opened.segments.xy, built.segments.xy)
    assert names(store) == [the_map(store).name]


@pytest.mark.slow
def test_every_input_counts(store, computes) -> None:
    inputs = (
        {}, {"env": room(4.1)}, {"spacing": 0.2}, {"radius": 0.6}, {"headings": 1},
        {"headings": 2}, {"map_std": 0.04}, {"tau": 3.0}, {"max_beams": 12},
        {"sigma_theta": 0.06}, {"outlier_share": 0.04}, {"low": 0.3}, {"high": 0.7},
        {"robot_radius": 0.2}, {"layers": "fisher"}, {"layers": ("fisher", "gfm")},
    )  # fmt: skip
    plain = [build(False, **one) for one in inputs]
    for count, one in enumerate(inputs, start=1):
        build(store, **one)
        assert len(names(store)) == count
    computes.clear()
    for wanted, one in zip(plain, inputs, strict=True):
        assert same(build(store, **one), wanted)
    assert not computes
    an.build_map(room(), laser(20), 0.25, store=store)
    assert len(computes) == 1


def test_defaults_are_the_numbers_that_they_stand_for(store, computes) -> None:
    build(store)
    build(store, map_std=0.02, max_beams=60)
    assert len(computes) == 1


def test_a_copy_of_a_building_is_the_same(store, computes, tmp_path) -> None:
    square = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]
    text = json.dumps({"type": "Polygon", "coordinates": [square]})
    for name in ("one", "other"):
        (tmp_path / f"{name}.geojson").write_text(text)
    one, other = (an.load_environment(tmp_path / f"{name}.geojson") for name in ("one", "other"))
    first, second = build(store, one), build(store, other)
    assert len(computes) == 1
    assert same(build(False, other), second)  # with the name and the place of its own
    assert first.dataset.attrs["environment"] == "one"
    assert second.dataset.attrs["environment_source"] == str(tmp_path / "other.geojson")
    assert same(build(store, one), first)


OFFICE = """image: {image}
resolution: {resolution}
origin: {origin}
occupied_thresh: {occupied}
free_thresh: 0.25
negate: 0
"""


def write_map(folder: Path, name: str, text: str = OFFICE, shade: int = 0, **values) -> Path:
    """Write a room of 4 by 3 m as a map_server file; `shade` darkens one grey cell in it."""
    folder.mkdir(exist_ok=True)
    pixels = np.full((80, 100), 254, dtype=np.uint8)
    pixels[[9, 70], 9:91] = pixels[9:71, 9] = pixels[9:71, 90] = 0
    pixels[30:34, 40:44] = 60
    pixels[50:54, 60:64] = 254 - shade
    Image.fromarray(pixels).save(folder / f"{name}.png")
    known = {"image": f"{name}.png", "resolution": 0.05, "origin": [0, 0, 0], "occupied": 0.65}
    path = folder / f"{name}.yaml"
    path.write_text(text.format(**known | values))
    return path


def test_what_is_in_a_map_file_counts_and_not_how_it_is_written(store, computes, tmp_path) -> None:
    first = an.load_environment(write_map(tmp_path / "a", "office"))
    build(store, first)
    reordered = "# surveyed again\n" + "\n".join(reversed(OFFICE.splitlines())) + "\n"
    second = an.load_environment(write_map(tmp_path / "b", "copy", reordered))
    assert first.checksum != second.checksum
    opened = build(store, second)
    assert len(computes) == 1 and opened.dataset.attrs["environment_sha256"] == second.checksum
    changes = ({"shade": 254}, {"occupied": 0.9}, {"resolution": 0.06}, {"origin": [1, 0, 0]})
    for count, change in enumerate(changes, start=2):
        build(store, an.load_environment(write_map(tmp_path / str(count), "office", **change)))
        assert len(computes) == count, change


def test_code_from_elsewhere_is_not_kept(store, computes, monkeypatch) -> None:
    def compute(context):
        return {"ones": context.spread(np.ones(len(context.points[0])))}

    layer = Layer(
        name="ones", title="ones", unit="1", worse="high", source="here", compute=compute
    )  # fmt: skip
    monkeypatch.setattr(LAYERS, "_registered", {"ones": layer})
    for _ in range(2):
        assert "ones" in build(store, layers="ones").layers
    assert len(computes) == 2 and not store.place.exists()

    class Mine(RangeScanner):
        pass

    for _ in range(2):
        an.build_map(room(), Mine(laser().parts), 0.25, store=store)
    assert len(computes) == 4 and not store.place.exists()


def test_other_code_and_libraries_are_other_maps(store, computes, monkeypatch) -> None:
    build(store)
    for name, change in (
        ("ambinav.runtime.provenance.code_digest", lambda: "edited"),
        ("ambinav.runtime.provenance.library_version", lambda name: "99.9"),
        ("llvmlite.binding.get_host_cpu_name", lambda: "z80"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(name, change)
            build(store)
    assert len(computes) == 4 and len(names(store)) == 4


# -- what is damaged, newer or left over ---------------------------------------------------------


@pytest.mark.parametrize("place", [0, 13, 60, 100, 0.3, 0.7, -1, "empty", "half", "other"])
def test_a_damaged_entry_is_set_aside_and_built_again(store, computes, place) -> None:
    built = build(store)
    path = the_map(store)
    whole = path.read_bytes()
    content = bytearray(whole)
    if place == "empty":
        content.clear()
    elif place == "half":
        del content[len(content) // 2 :]
    elif place == "other":
        content[:] = b"something else"
    else:
        content[int(place * len(whole)) if isinstance(place, float) else place] ^= 1
    path.write_bytes(content)
    with pytest.warns(an.InputWarning) as caught:
        again = build(store)
    (message,) = [str(one.message) for one in caught]
    assert (
        "damaged" in message
        and f"set aside as {path.stem}.damaged" in message
        and "\n" not in message
    )
    assert str(path) in message and message.endswith("computed again.")
    assert len(computes) == 2 and same(again, built)
    assert path.with_suffix(".damaged").read_bytes() == bytes(content)
    assert same(build(store), built) and len(computes) == 2


def test_another_entry_under_its_name(store, computes) -> None:
    build(store)
    first = the_map(store)
    build(store, spacing=0.3)
    (second,) = set(store.place.glob("*.map")) - {first}
    shutil.copy(first, second)
    with pytest.warns(an.InputWarning, match="another map"):
        assert build(store, spacing=0.3).spacing == 0.3
    assert len(computes) == 3


def test_an_entry_of_a_newer_format_is_left_alone(store, computes) -> None:
    built = build(store)
    path = the_map(store)
    content = path.read_bytes().replace(b"ambinav-map 1 ", b"ambinav-map 2 ", 1)
    path.write_bytes(content)
    for _ in range(2):
        with pytest.warns(
            an.InputWarning, match=r"newer ambinav \(format 2\), so it is left alone"
        ):
            assert same(build(store), built)
    assert len(computes) == 3 and path.read_bytes() == content
    assert store.make_room(-1) == [] and path.exists()


def test_what_killed_ones_left_goes(tmp_path) -> None:
    store = MapStore(tmp_path / "maps", SMALL)
    build(store)
    key, other = the_map(store).stem, "f" * 32
    for name in (key, other):
        half = store.place / f".{name}.map.abcd1234"
        half.mkdir()
        (half / f"{name}.map").write_bytes(b"half")
        (store.place / f"{name}.lock").touch()
    alive = build_lock.try_lock(store.place / f"{other}.lock")
    assert alive is not None
    with alive:
        build(store, spacing=0.3)
        assert names(store) == sorted(
            [*(path.name for path in store.place.glob("*.map")), f"{other}.lock",
             f".{other}.map.abcd1234"]
        )  # fmt: skip
    store.make_room(LIMIT)
    assert len(names(store)) == 2


def test_nothing_that_others_wrote_goes(tmp_path, monkeypatch) -> None:
    """In a folder that is a repository, with files that look a little like ours."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AMBINAV_CACHE", ".")
    store = replace(MapStore.of_user(), limit=SMALL)
    assert store.place == Path(map_store.MAPS)
    target = tmp_path / "target"
    for place in (tmp_path, store.place, target):
        (place / ".git").mkdir(parents=True)
        (place / ".git" / "HEAD").write_text("ref: refs/heads/main")
        (place / ("0" * 16)).mkdir()
        for name in ("bundle.js.map", "old.damaged", ".hidden", "poetry.lock", "A" * 32 + ".map"):
            (place / name).write_text("not ours")
        (place / f".{'c' * 32}.map.precious").symlink_to(target)
        (place / f"{'d' * 32}.map").symlink_to(target / "old.damaged")
    before = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*"))
    build(store)
    upkeep.prune(store, 0, other_code=True, every=True)
    with pytest.warns(an.InputWarning, match="the limit is 1 B"):
        build(replace(store, limit=1), spacing=0.3)
    after = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*"))
    assert after == sorted([*before, Path(map_store.MAPS) / map_store.TAG])


def test_the_folder_is_tagged_as_a_cache(store) -> None:
    build(store)
    tag = store.place / map_store.TAG
    assert tag.read_bytes().startswith(b"Signature: 8a477f597d28d172789f06886806bc55\n")
    tag.write_text("another")
    build(store, spacing=0.3)
    assert tag.read_text() == "another"


# -- room ----------------------------------------------------------------------------------------


def fill(store: MapStore, count: int) -> tuple[list[str], int]:
    """Keep so many maps of the same size, one after the other."""
    keys = [f"{k:032x}" for k in range(count)]
    for moment, key in enumerate(keys):
        store.opened_or_built(key, lambda alive: an.AmbiguityMap(synthetic.dataset()))
        if store.path(key).exists():
            os.utime(store.path(key), (1000 + moment, 1000 + moment))
    return keys, store.path(keys[-1]).stat().st_size


def test_least_recently_used_goes_first(tmp_path) -> None:
    _, size = fill(MapStore(tmp_path / "one"), 1)
    store = MapStore(tmp_path / "maps", limit=int(3.5 * size))
    keys, _ = fill(store, 3)
    assert store.opened_or_built(keys[0], pytest.fail)[1]  # used again
    fresh = "e" * 32
    assert not store.opened_or_built(fresh, lambda alive: an.AmbiguityMap(synthetic.dataset()))[1]
    assert {path.stem for path in store.files()} == {keys[0], keys[2], fresh}
    store.set_aside(keys[0])
    store.make_room(int(2.5 * size))
    assert {path.stem for path in store.files()} == {keys[2], fresh}


def test_what_others_added_meanwhile_counts(tmp_path) -> None:
    """Two that make room at once, each for its own map."""
    _, size = fill(MapStore(tmp_path / "one"), 1)
    store = MapStore(tmp_path / "maps", limit=int(2.5 * size))
    replacing = map_store.replacing

    @contextlib.contextmanager
    def slowly(path):
        if path.stem == "b" * 32:
            fill(store, 2)
        with replacing(path) as fresh:
            yield fresh

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(map_store, "replacing", slowly)
        store.opened_or_built("b" * 32, lambda alive: an.AmbiguityMap(synthetic.dataset()))
    assert sum(path.stat().st_size for path in store.files()) <= store.limit
    assert store.path("b" * 32).exists()


@pytest.mark.slow
def test_the_folder_is_looked_through_often_enough() -> None:
    """Of small maps about one for each thousandth of the limit; never is a hundredth added unseen.

    That is how much is left free when it is looked through.
    """
    store = MapStore(Path("maps"))
    rng = np.random.default_rng(4)
    size, count = 50_000, 100_000
    due = [store._is_due(rng.bytes(16).hex(), size) for _ in range(count)]
    assert 0.9 < sum(due) / (1000 * size * count / LIMIT) < 1.1
    assert np.diff(np.flatnonzero([True, *due, True])).max() * size < LIMIT / 100
    assert all(store._is_due(rng.bytes(16).hex(), LIMIT // 1000) for _ in range(1000))
    assert not any(store._is_due("f" * 32, one) for one in (0, size, LIMIT // 1001))


def test_a_map_without_room_is_returned_and_not_kept(tmp_path, computes) -> None:
    fill(MapStore(tmp_path / "maps"), 2)
    store = MapStore(tmp_path / "maps", limit=1000)
    with pytest.warns(an.InputWarning, match=r"limit is 1 kB.*; raise AMBINAV_CACHE_LIMIT\.$"):
        assert same(build(store), build(False))
    assert len(store.files()) == 2  # nobody went for it


FULL = """
import resource, sys, warnings
from pathlib import Path
from ambinav.store.map_store import MapStore
from tests.store.scenes import build
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    amap = build(MapStore(Path(sys.argv[1])))
print(amap.dataset["level"].values.tobytes().hex())
print([str(one.message) for one in caught])
"""


@pytest.mark.sweep
def test_a_full_disk_costs_no_map(store) -> None:
    """The system ends the writing in its middle, here by a limit on the size of files."""
    process = python(FULL, str(store.place))
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    level, messages = out.splitlines()
    assert level == build(False).dataset["level"].values.tobytes().hex()
    assert messages.count("cannot be kept") == 1 and "File too large" in messages
    assert names(store) == []


@pytest.mark.parametrize("obstacle", ["a file", "no rights"])
def test_a_folder_that_cannot_be_written(tmp_path, obstacle) -> None:
    place = tmp_path / "place"
    if obstacle == "a file":
        place.write_text("in the way")
    elif os.geteuid() == 0:
        place = Path("/proc/ambinav")
    else:
        place.mkdir(mode=0o500)
    with pytest.warns(an.InputWarning, match="cannot be kept here") as caught:
        assert same(build(MapStore(place / "maps")), build(False))
    (warning,) = caught
    assert "\n" not in str(warning.message) and "AMBINAV_CACHE" in str(warning.message)


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("ambinav.store.entry.pack", MemoryError(), "no memory is left"),
        ("os.scandir", PermissionError(13, "Permission denied"), "Permission denied"),
    ],
)
def test_no_memory_and_a_folder_that_cannot_be_listed(
    tmp_path, monkeypatch, name, error, message
) -> None:
    store = MapStore(tmp_path / "maps", SMALL)

    def failing(*arguments):
        raise error

    plain = build(False)
    monkeypatch.setattr(name, failing)
    with pytest.warns(an.InputWarning, match=f"cannot be kept here .*{message}") as caught:
        assert same(build(store), plain)
    assert len(caught) == 1
    monkeypatch.undo()
    assert names(store) == []


def test_a_folder_without_rights(store, monkeypatch) -> None:
    """As it is said to one who is not root."""
    monkeypatch.setattr(os, "access", lambda *arguments: False)
    with pytest.warns(an.InputWarning) as caught:
        build(store)
    (message,) = [str(one.message) for one in caught]
    assert f"(the folder {store.place} is not writable), so the next run computes" in message


def test_where_there_is_room_no_file_is_looked_into(store, monkeypatch) -> None:
    """What keeping a map costs beside thousands of others."""
    _, size = fill(store, 3)
    looked: list[Path] = []
    read = entry.read_format
    monkeypatch.setattr(entry, "read_format", lambda path: looked.append(path) or read(path))
    assert store.make_room(3 * size) == [] and looked == []
    assert len(store.make_room(2 * size)) == 1 and len(looked) == 3


def test_what_the_build_raises_is_raised_and_nothing_stays(store) -> None:
    def broken(alive):
        raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            store.opened_or_built("a" * 32, broken)
        assert names(store) == []
    with pytest.raises(an.InputError, match="radius"):
        build(store, radius=0.1)


def test_no_warning_in_a_plain_run(store) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        build(store)
        build(store)
    assert entry.read_format(the_map(store)) == entry.FORMAT
