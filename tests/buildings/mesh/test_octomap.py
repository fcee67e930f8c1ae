"""OctoMaps: one written bit by bit here, broken ones, and a recorded building beside its voxels."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from ambinav.buildings.mesh.floor import floor_environment
from ambinav.buildings.mesh.octomap import read_leaves, read_octomap
from ambinav.buildings.mesh.voxels import voxel_mesh
from ambinav.runtime.errors import InputError

HEAD = "# Octomap OcTree binary file\n# (feel free to add / change comments)\n#\nid {}\nsize 9\n"
UNKNOWN, FREE, OCCUPIED, INNER = 0b00, 0b01, 0b10, 0b11


def written(path: Path, nodes: list[int], kind: str = "OcTree", res: str = "0.1") -> Path:
    head = HEAD.format(kind) + f"res {res}\ndata\n"
    path.write_bytes(head.encode() + np.array(nodes, dtype="<u2").tobytes())
    return path


def node(*children: int) -> int:
    return sum(child << (2 * i) for i, child in enumerate(children))


def test_two_voxels_beside_each_other(tmp_path: Path) -> None:
    # The child towards +x, +y, +z, and then always the lowest one: that ends at the middle.
    down = [node(*[UNKNOWN] * 7, INNER), *[node(INNER)] * 14]
    path = written(tmp_path / "two.bt", [*down, node(OCCUPIED, OCCUPIED, FREE)])
    leaves, edge = read_leaves(path)
    assert edge == 0.1
    assert leaves.size.tolist() == [1, 1, 1]
    assert leaves.occupied.tolist() == [True, True, False]
    mesh = read_octomap(path)
    assert mesh.bounds == pytest.approx(np.array([(0.0, 0.0, 0.0), (0.2, 0.1, 0.1)]))
    assert (len(mesh.faces), mesh.open_edges) == (20, 0)
    # Faces look outward.
    middle = mesh.triangles.mean(axis=1) - (0.1, 0.05, 0.05)
    assert ((middle * mesh.surface_normal).sum(axis=1) > 0.0).all()


def test_a_large_leaf_is_its_voxels(tmp_path: Path) -> None:
    down = [node(*[UNKNOWN] * 7, INNER), *[node(INNER)] * 12]
    mesh = read_octomap(written(tmp_path / "large.bt", [*down, node(OCCUPIED)]))
    assert mesh.bounds == pytest.approx(np.array([(0.0, 0.0, 0.0), (0.4, 0.4, 0.4)]))
    assert len(mesh.faces) == 6 * 16 * 2


def test_refused(tmp_path: Path) -> None:
    down = [node(*[UNKNOWN] * 7, INNER), *[node(INNER)] * 14]
    other = tmp_path / "other.bt"
    other.write_bytes(b"ply\nformat ascii 1.0\n")
    for path, text in (
        (written(tmp_path / "cut.bt", down), "cut off or damaged"),
        (written(tmp_path / "none.bt", []), "cut off or damaged"),
        (written(tmp_path / "more.bt", [*down, node(OCCUPIED), 7]), "cut off or damaged"),
        (written(tmp_path / "deep.bt", [node(INNER)] * 20), "cut off or damaged"),
        (written(tmp_path / "free.bt", [*down, node(FREE)]), "nothing in it is occupied"),
        (written(tmp_path / "time.bt", down, "OcTreeStamped"), "id is 'OcTreeStamped'"),
        (written(tmp_path / "res.bt", down, res="-1"), "res is '-1'"),
        (written(tmp_path / "word.bt", down, res="fine"), "res is 'fine'"),
        (written(tmp_path / "full.bt", [node(OCCUPIED)]), "a block of 32768 voxels of 0.1 m"),
        (other, "this is not an OctoMap"),
        (tmp_path / "missing.bt", "cannot be read"),
        (tmp_path, "cannot be read"),
    ):
        with pytest.raises(InputError, match=text) as caught:
            read_octomap(path)
        assert str(path) in str(caught.value)


def test_a_colour_tree_in_binary_is_a_plain_one(tmp_path: Path) -> None:
    down = [node(*[UNKNOWN] * 7, INNER), *[node(INNER)] * 14, node(OCCUPIED, FREE)]
    plain, _ = read_leaves(written(tmp_path / "plain.bt", down))
    colour, _ = read_leaves(written(tmp_path / "colour.bt", down, "ColorOcTree"))
    for one, other in zip(plain, colour, strict=True):
        np.testing.assert_array_equal(one, other)


def full(path: Path, binary: list[int], kind: str, cut: int = 0) -> Path:
    """Write the tree of a binary file's nodes as a full one, by recursion."""
    colour = b"\x10\x20\x30" if kind == "ColorOcTree" else b""
    rest = iter(binary)

    def written_node(odds: float, inner: bool) -> bytes:
        own = next(rest) if inner else 0
        kinds = [(own >> (2 * i)) & 3 for i in range(8)]
        mask = sum(1 << i for i, of in enumerate(kinds) if of != UNKNOWN)
        parts = [struct.pack("<f", odds), colour, bytes([mask])]
        parts += [
            written_node({FREE: -0.4, OCCUPIED: 0.85, INNER: 0.2}[of], of == INNER)
            for of in kinds
            if of != UNKNOWN
        ]
        return b"".join(parts)

    body = written_node(0.1, True)
    head = HEAD.format(kind).replace(" binary", "") + "res 0.1\ndata\n"
    path.write_bytes(head.encode() + body[: len(body) - cut])
    return path


@pytest.mark.parametrize("kind", ["OcTree", "ColorOcTree"])
def test_a_full_tree_has_the_leaves_of_its_binary_file(tmp_path: Path, kind: str) -> None:
    nodes = [
        node(OCCUPIED, *[UNKNOWN] * 5, FREE, INNER), node(INNER, FREE, INNER, OCCUPIED),
        node(FREE, FREE), node(*[OCCUPIED] * 8),
    ]  # fmt: skip
    wanted, edge = read_leaves(written(tmp_path / "tree.bt", nodes))
    found, same = read_leaves(full(tmp_path / "tree.ot", nodes, kind))
    assert edge == same == 0.1 and wanted.occupied.sum() == 10
    for one, other in zip(wanted, found, strict=True):
        np.testing.assert_array_equal(one, other)
    for cut in (1, 5, 8, 16, 40):
        with pytest.raises(InputError, match="cut off or damaged"):
            read_leaves(full(tmp_path / f"cut{cut}.ot", nodes, kind, cut))


@pytest.mark.slow
def test_a_recorded_building_as_a_full_colour_tree(data_dir: Path, tmp_path: Path) -> None:
    recorded = data_dir / "mesh3d" / "geb079.bt"
    body = recorded.read_bytes().partition(b"\ndata\n")[2]
    nodes = np.frombuffer(body, dtype="<u2").tolist()
    wanted, _ = read_leaves(recorded)
    found, _ = read_leaves(full(tmp_path / "geb079.ot", nodes, "ColorOcTree"))
    for one, other in zip(wanted, found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_a_recorded_building_has_the_voxels_that_others_read_from_it(data_dir: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    leaves, edge = read_leaves(data_dir / "mesh3d" / "geb079.bt")
    # As data/README.md has it.
    assert (edge, int(leaves.occupied.sum()), int((~leaves.occupied).sum())) == (
        0.08, 143_729, 284_415,
    )  # fmt: skip
    key, size = leaves.key[leaves.occupied], leaves.size[leaves.occupied]
    cells = trimesh.load(data_dir / "mesh3d" / "geb079_occupied_voxels.ply").vertices
    cells = np.unique(np.floor(np.asarray(cells) / edge).astype(int) + (1 << 15), axis=0)
    assert len(cells) == int((size**3).sum())
    single = {tuple(row) for row in key[size == 1].tolist()}
    assert single <= {tuple(row) for row in cells.tolist()}


def test_an_octomap_in_feet_has_a_unit(tmp_path: Path) -> None:
    down = [node(*[UNKNOWN] * 7, INNER), *[node(INNER)] * 12, node(OCCUPIED)]
    path = written(tmp_path / "feet.bt", down, res="1.0")
    assert np.ptp(read_octomap(path, unit="ft").bounds, axis=0) == pytest.approx([1.2192] * 3)
    with pytest.raises(InputError, match="unit is 'yard'; it must be m, cm, mm, in, ft"):
        read_octomap(path, unit="yard")


def test_a_layer_of_noise_is_floor() -> None:
    """Voxels of an OctoMap are those of a scan, whose noise puts a floor into two layers."""
    high = np.array([(i, j, int((i + j) % 7 == 0)) for i in range(80) for j in range(50)])
    base = np.array([(i, j, 0) for i in range(80) for j in range(50)])
    walls = np.array([(i, j, k) for i in range(80) for j in (0, 49) for k in range(25)])
    voxels = np.unique(np.concatenate([base, high, walls]), axis=0)
    mesh = voxel_mesh(voxels, 0.1, name="noisy", source=Path("noisy.bt"), scanned=True)
    assert floor_environment(mesh, 0.5, 0.2).free.area > 0.9 * 8.0 * 4.8
