"""What scanners read on a drive: as the scanner itself, with people before the walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy.stats import chisquare

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.drive.clutter import scattered_boxes, with_obstacles
from ambinav.drive.people import Crowd, People
from ambinav.drive.readings import Readings, standard_normals
from ambinav.localization.random import states
from ambinav.runtime.errors import InputError
from ambinav.sensing import Intensity, RangeScanner, RangeSensor, read_intensity
from tests.drive.cases import from_polyline, laser
from tests.geometry.scenes import points_inside, room, scene


def table(runs: int, seed: int = 0) -> np.ndarray:
    return states(np.random.default_rng(seed), runs)


@pytest.mark.parametrize("preset", ["hokuyo-urg-04lx", "polaroid-6500-ring"])
def test_true_ranges_are_the_scanner_s(preset: str) -> None:
    env, scanner = scene(4, size=15.0), RangeScanner.from_preset(preset)
    xy = points_inside(env, 20, 1, margin=0.5)
    poses = np.column_stack([xy, np.linspace(-3.0, 3.0, 20)])
    want = scanner.scan(env, *poses.T)
    np.testing.assert_array_equal(Readings(env, scanner).true_ranges(poses), want)
    nobody = np.empty((20, 0, 3))
    np.testing.assert_array_equal(Readings(env, scanner).true_ranges(poses, nobody, 0.3), want)


@pytest.mark.parametrize("preset", ["hokuyo-urg-04lx", "polaroid-6500-ring"])
def test_some_beams_read_as_among_all(preset: str) -> None:
    env, scanner = scene(4, size=15.0), RangeScanner.from_preset(preset)
    poses = np.column_stack([points_inside(env, 5, 1, margin=0.5), np.linspace(-3.0, 3.0, 5)])
    beams = np.array([1, 2, 5, scanner.beams - 1])
    every, some = Readings(env, scanner), Readings(env, scanner, beams)
    true = every.true_ranges(poses)
    np.testing.assert_array_equal(some.true_ranges(poses), true[:, beams])
    for whole, part in zip(every.moments(true), some.moments(true[:, beams]), strict=True):
        np.testing.assert_array_equal(part, whole[:, beams])
    np.testing.assert_array_equal(some.sensors, every.sensors[beams])


@pytest.mark.parametrize("true", [0.22, 1.0, 1.97, math.inf])
def test_readings_have_the_sensor_s_probabilities(true: float) -> None:
    sensor = RangeSensor(
        min_range=0.2, max_range=2.0, resolution=0.05, bias=0.01, std=0.06, random_share=0.1,
        lost_share=0.05,
    )  # fmt: skip
    scanner = RangeScanner.planar(sensor=sensor, beams=7, aperture=1.0, mount=(0.0, 0.0, 0.0))
    sight = Readings(room(5.0, 5.0), scanner)
    drawn = sight.capture(np.full((3000, 7), true, dtype=np.float32), table(3000))
    found = np.bincount(sensor.column(drawn).ravel(), minlength=sensor.bins + 2)
    want = sensor.reading_probabilities(float(np.float32(true))) * drawn.size
    some = want > 5.0
    assert found[~some].sum() <= 10 + 2 * want[~some].sum()
    scale = found[some].sum() / want[some].sum()
    assert chisquare(found[some], want[some] * scale).pvalue > 1e-4


def test_readings_of_a_run_are_its_own() -> None:
    sight = Readings(room(5.0, 5.0), laser(beams=9))
    true = np.full((4, 9), 2.0, dtype=np.float32)
    four, two = sight.capture(true, table(4)), sight.capture(true[:2], table(2))
    np.testing.assert_array_equal(four[:2], two)
    assert len(np.unique(four[:, 0])) > 1
    assert standard_normals(table(3), 2)[:2] == pytest.approx(standard_normals(table(2), 2))


def test_a_sensor_in_the_wall_reads_too_near() -> None:
    sight = Readings(room(5.0, 5.0), laser(beams=5, random_share=0.0))
    ranges = sight.true_ranges(np.array([[-0.1, 2.0, 0.0]]))
    assert np.isnan(ranges).all()
    assert (sight.capture(ranges, table(1)) == -np.inf).all()


def test_a_person_hides_the_wall_behind() -> None:
    sight = Readings(room(10.0, 4.0), laser(max_range=8.0, beams=8))
    poses = np.array([[2.0, 2.0, 0.0], [2.0, 2.0, math.pi / 4]])
    people = np.array([[[5.0, 2.1, 0.0]], [[5.0, 2.1, 0.0]]])
    free = sight.true_ranges(poses)
    seen = sight.true_ranges(poses, people, 0.25)
    ahead = 3.0 - math.sqrt(0.25**2 - 0.1**2)
    # Beam k of a full circle looks along 45 degrees * k from its own start on.
    mounts = laser(max_range=8.0, beams=8).mounts[:, 2]
    for run, t in enumerate((0.0, math.pi / 4)):
        along = np.abs((mounts + t + math.pi) % (2 * math.pi) - math.pi) < 1e-9
        assert seen[run, along] == pytest.approx(ahead, abs=1e-6)
        np.testing.assert_array_equal(seen[run, ~along], free[run, ~along])


def test_a_person_behind_the_wall_out_of_range_or_on_the_robot_changes_nothing() -> None:
    sight = Readings(room(10.0, 4.0), laser(max_range=2.0, beams=8))
    pose = np.array([[2.0, 2.0, 0.0]])
    free = sight.true_ranges(pose)
    for place in ([-1.0, 2.0, 0.0], [6.0, 2.0, 0.0], [2.1, 2.0, 0.0]):
        people = np.array([[place]])
        np.testing.assert_array_equal(sight.true_ranges(pose, people, 0.25), free)


def test_a_cone_sees_the_nearest_of_person_and_wall() -> None:
    sensor = RangeSensor(
        aperture=math.radians(30.0), max_range=6.0, resolution=0.01, std=0.01, max_incidence=0.5
    )
    scanner = RangeScanner.planar(sensor=sensor, beams=1, aperture=0.0, mount=(0.0, 0.0, 0.0))
    sight = Readings(room(10.0, 4.0), scanner)
    people = np.array([[[4.0, 2.0, 0.0]]])
    assert sight.true_ranges(np.array([[2.0, 2.0, 0.0]]), people, 0.3)[0, 0] == pytest.approx(1.7)


def test_people_stay_in_the_free_space_and_keep_their_pace() -> None:
    env = scene(4, size=15.0)
    poses = np.tile([*points_inside(env, 1, 3, margin=0.5)[0], 0.0], (3, 1))
    crowd = Crowd(env, People(5, speed=1.2), 0.22, poses, table(3))
    start = crowd.places.copy()
    far = np.hypot(*(start[..., :2] - poses[:, None, :2]).transpose(2, 0, 1))
    assert far.min() > 0.22 + 0.25
    for _ in range(200):
        before = crowd.places.copy()
        crowd.walk(poses, 0.1)
        gone = np.hypot(*(crowd.places - before)[..., :2].transpose(2, 0, 1))
        assert np.isclose(gone, 0.12).sum() + (gone == 0.0).sum() == gone.size
        assert env.is_free(crowd.places[..., 0], crowd.places[..., 1], 0.25 - 1e-6).all()
    assert np.hypot(*(crowd.places - start)[..., :2].transpose(2, 0, 1)).max() > 1.0


def test_the_people_of_a_run_are_its_own() -> None:
    env, poses = room(10.0, 10.0), np.full((4, 3), 5.0)
    crowds = [Crowd(env, People(3), 0.22, poses[:n], table(n)) for n in (4, 2)]
    for crowd, n in zip(crowds, (4, 2), strict=True):
        for _ in range(20):
            crowd.walk(poses[:n], 0.1)
    np.testing.assert_array_equal(crowds[0].places[:2], crowds[1].places)


def test_people_give_way_to_the_robot() -> None:
    env, robot = room(10.0, 10.0), np.array([[5.0, 5.0, 0.0]])
    crowd = Crowd(env, People(1), 0.22, robot, table(1))
    crowd.places[0, 0] = 5.5, 5.0, math.pi
    crowd.walk(robot, 0.1)
    assert crowd.places[0, 0] == pytest.approx([5.6, 5.0, 0.0])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"count": -1}, "count is -1"),
        ({"count": 1.5}, "count is 1.5"),
        ({"count": 1, "radius": 0.0}, "radius is 0"),
        ({"count": 1, "speed": -1.0}, "speed is -1"),
        ({"count": 1, "speed": math.nan}, "speed is nan"),
    ],
)
def test_bad_people_are_refused(values: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=f"people: {words}"):
        People(**values)


def test_a_room_may_be_too_small_for_people() -> None:
    with pytest.raises(InputError, match="no room for 1"):
        Crowd(room(1.0, 1.0), People(1), 0.22, np.array([[0.5, 0.5, 0.0]]), table(1))


def test_an_obstacle_stands_in_the_world() -> None:
    env = room(10.0, 4.0)
    full = with_obstacles(env, [shapely.box(5.0, 1.0, 6.0, 3.0), shapely.box(9.0, 3.0, 11.0, 5.0)])
    assert full.free.area == pytest.approx(40.0 - 2.0 - 1.0)
    assert full.cast(1.0, 2.0, 0.0, 20.0) == pytest.approx(4.0)
    assert full.cast(1.0, 3.5, 0.0, 20.0) == pytest.approx(8.0)
    assert full.cast(1.0, 0.5, 0.0, 20.0) == pytest.approx(9.0)
    assert not full.is_free(5.5, 2.0) and not full.is_free(4.9, 2.0, 0.2)
    assert full.clearance(4.5, 2.0) == pytest.approx(0.5)
    assert env.cast(1.0, 2.0, 0.0, 20.0) == pytest.approx(9.0)
    assert with_obstacles(env, []) is env


def test_an_obstacle_must_be_a_polygon() -> None:
    with pytest.raises(InputError, match=r"obstacles\[0\] is a Point"):
        with_obstacles(room(4.0, 4.0), [shapely.Point(1.0, 1.0)])


@pytest.mark.slow
def test_boxes_keep_off_the_route() -> None:
    env, route = room(10.0, 10.0), np.array([[1.0, 1.0, 0.0], [9.0, 9.0, 0.0]])
    boxes = scattered_boxes(env, 12, np.random.default_rng(2), route=route, margin=0.6)
    assert len(boxes) == 12 and all(env.free.contains(box) for box in boxes)
    corners = shapely.get_coordinates(boxes)
    assert from_polyline(corners, route).min() >= 0.6
    again = scattered_boxes(env, 12, np.random.default_rng(2), route=route, margin=0.6)
    assert boxes == again
    with pytest.raises(InputError, match="room for 0 boxes"):
        scattered_boxes(room(0.5, 0.5), 1, np.random.default_rng(0), sizes=(0.6, 0.7))
    with pytest.raises(InputError, match="sizes"):
        scattered_boxes(env, 1, np.random.default_rng(0), sizes=(0.5, 0.1))
    with pytest.raises(InputError, match="count is -1"):
        scattered_boxes(env, -1, np.random.default_rng(0))


def test_intensities_are_of_what_a_beam_meets() -> None:
    """The tag, the wall, a person before the tag; none without an echo, none without a channel."""
    env = environment_from_shapes([shapely.box(0, 0, 8, 4)], reflectors=[[(7.8, 1.5), (7.8, 2.5)]])
    channel = Intensity(wall=0.3, reflector=1.0, std=0.1)
    scanner = RangeScanner.mixed(
        laser(max_range=6.5, beams=4, random_share=0.0).with_intensity(channel),
        laser(max_range=6.5, beams=4, random_share=0.0),
    )
    sight = Readings(env, scanner)
    # Beams look back, down, ahead and up; the first robot is too far from the tag.
    poses = np.repeat([[1.0, 2.0, 0.0], [4.0, 2.0, 0.0], [4.0, 2.0, 0.0]], 500, axis=0)
    people = np.full((1500, 1, 3), -9.0)
    people[1000:, 0] = 6.0, 2.0, 0.0
    true, reflects = sight.look(poses, people, 0.3)
    np.testing.assert_array_equal(true, sight.true_ranges(poses, people, 0.3))
    # Of a beam without a channel what it meets is known, and not read.
    assert reflects[:, [2, 6]].any(axis=1).tolist() == [False] * 500 + [True] * 500 + [False] * 500
    assert not reflects[:, [0, 1, 3]].any()
    ranges = sight.capture(true, table(1500))
    read = sight.intensities(reflects, ranges, table(1500, 1))
    assert np.isnan(read[:, 4:]).all()
    assert (np.isnan(read[:, :4]) == np.isinf(ranges[:, :4])).all()
    assert np.isnan(read[:500, 2]).all()
    for rows, mean in ((slice(500, 1000), 1.0), (slice(1000, 1500), 0.3)):
        assert read[rows, 2].mean() == pytest.approx(mean, abs=0.02)
        assert read[rows, 2].std() == pytest.approx(0.1, abs=0.02)
    # As the scanner itself reads them.
    rng = np.random.default_rng(0)
    alone = read_intensity(scanner, env, *poses[500:1000].T, ranges[500:1000], rng)
    assert alone[:, 2].mean() == pytest.approx(1.0, abs=0.02)
    assert (np.isnan(alone) == np.isnan(read[500:1000])).all()
