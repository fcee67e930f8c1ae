"""The particle filter of another project (https://pypi.org/project/pfilter/) as a localizer.

pfilter knows nothing of ambinav, and ambinav nothing of it: they exchange lines of JSON.
`localizer.yaml` beside this file names the command, docs/howto/outside-localizer.md the messages.
"""

import json
import sys
from pathlib import Path

import numpy as np
import yaml
from pfilter import ParticleFilter, systematic_resample
from PIL import Image
from scipy.ndimage import distance_transform_edt

PARTICLES, BEAMS = 400, 30
HIT_STD, RANDOM, EXPONENT = 0.1, 0.05, 0.3
"""Deviation of a hit, metres; likelihood of a random reading; power, as neighbours err together."""
BEYOND = 2.0
"""Metres around the map in which distances are known."""
EVERY = 0.25, 0.2
"""Metres or radians from one scan that is taken in to the next."""


def distances(file):
    """Return distances to the nearest wall, metres, with the corner and the edge of the cells."""
    header = yaml.safe_load(Path(file).read_text())
    with Image.open(Path(file).with_name(header["image"])) as image:
        occupied = np.flipud(np.asarray(image)) == 0
    size = header["resolution"]
    # The map ends at its outermost walls; end points may lie beyond.
    beyond = round(BEYOND / size)
    field = distance_transform_edt(~np.pad(occupied, beyond)) * size
    return field, np.array(header["origin"][:2]) - beyond * size, size


class Robot:
    """One robot's filter."""

    def __init__(self, setting, field):
        self.field, self.corner, self.size = field
        self.beams = np.array(setting["beams"])
        self.shown = np.unique(np.linspace(0, len(self.beams) - 1, BEAMS).astype(int))
        self.near, self.far = np.array(setting["range_min"]), np.array(setting["range_max"])
        self.alpha = [setting["odometry"][f"alpha{k}"] for k in (1, 2, 3, 4)]

    def start(self, pose, covariance):
        """Draw particles about a pose."""
        self.pose, self.covariance, self.anchor = np.array(pose), np.array(covariance), None
        self.filter = ParticleFilter(
            prior_fn=lambda n: np.random.multivariate_normal(pose, covariance, n),
            dynamics_fn=self.moved,
            noise_fn=lambda particles, **kwargs: particles,
            observe_fn=self.to_walls,
            weight_fn=lambda to_walls, _, **kwargs: self.likelihood(to_walls),
            resample_fn=systematic_resample,
            n_particles=PARTICLES,
            n_eff_threshold=0.5,
        )

    def take(self, odometry, ranges):
        """Move along with odometry; take the scan in if it has moved far enough. Return if so."""
        odometry = np.array(odometry)
        if self.anchor is None:
            self.anchor, self.base = odometry, self.pose
        motion = between(self.anchor, odometry)
        self.pose = step(self.base[np.newaxis], motion)[0]
        if np.hypot(*motion[:2]) < EVERY[0] and abs(motion[2]) < EVERY[1]:
            return False
        ranges = np.array([np.nan if r is None else r for r in ranges])
        ranges[(ranges < self.near) | (ranges > self.far)] = np.nan
        self.filter.update(np.zeros(1), motion=motion, ranges=ranges)
        self.pose = self.base = self.filter.mean_state
        self.covariance, self.anchor = self.filter.cov_state, odometry
        return True

    def moved(self, particles, motion, ranges):
        """Move particles with errors as in AMCL's model."""
        metres, turn = np.hypot(*motion[:2]), abs(motion[2])
        heading = np.sqrt(self.alpha[0] * turn**2 + self.alpha[1] * metres**2)
        along = np.sqrt(self.alpha[2] * metres**2 + self.alpha[3] * turn**2)
        noise = np.random.normal(size=particles.shape)
        motions = np.array(motion) * (1.0 + along * noise[:, :1] / max(metres, 1e-9) * [[1, 1, 0]])
        turned = particles + [[0, 0, 1]] * (heading * noise[:, 1:2])
        return step(turned, motions) + [[0, 0, 1]] * (heading * noise[:, 2:])

    def to_walls(self, particles, motion, ranges):
        """Return how far the end points are from walls, (N, beams that have an echo)."""
        used = self.shown[np.isfinite(ranges[self.shown])]
        x, y, yaw = self.beams[used].T
        ahead, left = x + ranges[used] * np.cos(yaw), y + ranges[used] * np.sin(yaw)
        c, s = np.cos(particles[:, 2:]), np.sin(particles[:, 2:])
        ends = np.stack([c * ahead - s * left, s * ahead + c * left], axis=-1)
        ends += particles[:, np.newaxis, :2] - self.corner
        column, row = np.moveaxis((ends / self.size).astype(int), -1, 0)
        rows, columns = self.field.shape
        return self.field[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]

    def likelihood(self, to_walls):
        """Return the product over the beams, to a power."""
        each = np.exp(-0.5 * (to_walls / HIT_STD) ** 2) + RANDOM
        return np.exp(EXPONENT * np.log(each).sum(axis=1))


def between(before, after):
    """Return a motion in the frame of the pose before it."""
    c, s = np.cos(before[2]), np.sin(before[2])
    dx, dy, turn = after - before
    return c * dx + s * dy, c * dy - s * dx, (turn + np.pi) % (2 * np.pi) - np.pi


def step(poses, motion):
    """Move poses, (N, 3), by motions in their frames."""
    ahead, left, turn = np.moveaxis(np.asarray(motion), -1, 0)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return poses + np.stack(
        np.broadcast_arrays(c * ahead - s * left, s * ahead + c * left, turn), axis=-1
    )


def main():
    """Answer one message after the other."""
    setting = json.loads(sys.stdin.readline())
    np.random.seed(setting["seed"])
    field = distances(setting["map"])
    robots = [Robot(setting, field) for _ in range(setting["runs"])]
    print("{}", flush=True)
    for line in sys.stdin:
        message, answer = json.loads(line), {}
        if "start" in message:
            for robot, pose in zip(robots, message["start"], strict=True):
                robot.start(pose, message["covariance"])
        else:
            scans = zip(robots, message["odometry"], message["ranges"], strict=True)
            answer["used"] = [robot.take(*scan) for robot, *scan in scans]
            answer["pose"] = [robot.pose.tolist() for robot in robots]
            answer["covariance"] = [robot.covariance.tolist() for robot in robots]
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
