// The expected scan without a server: rays of the scanner against the walls near the robot.

/**
 * One scan without noise, as `ambinav.audit.sight.look` makes it.
 *
 * @param walls Float32Array of ax, ay, bx, by, metres from the corner of the map.
 * @param rays  origin, angle, start, max_range, max_incidence of `ambinav.sensing.rays.RayTable`.
 * @returns x, y (where each beam ends, same frame) and hit (whether it returns an echo).
 */
export function castScan(walls, rays, x, y, theta) {
  const [c, s] = [Math.cos(theta), Math.sin(theta)];
  const far = rays.max_range.reduce((most, range) => Math.max(most, range), 0) + 1;
  const near = nearWalls(walls, x, y, far);
  const cast = { x: [], y: [], hit: [] };
  for (let beam = 0; beam + 1 < rays.start.length; beam += 1) {
    let best = null;
    for (let ray = rays.start[beam]; ray < rays.start[beam + 1]; ray += 1) {
      const [ox, oy] = [rays.origin[2 * ray], rays.origin[2 * ray + 1]];
      const from = [x + c * ox - s * oy, y + s * ox + c * oy];
      const angle = theta + rays.angle[ray];
      const { distance, incidence } = castRay(near, from[0], from[1], angle);
      const echoes = distance <= rays.max_range[ray] && incidence <= rays.max_incidence[ray];
      const reach = echoes ? distance : Infinity;
      // Of a cone without echo its axis is drawn, which is the ray in the middle.
      const isAxis = ray === (rays.start[beam] + rays.start[beam + 1] - 1) >> 1;
      if (best === null || reach < best.reach || (best.reach === Infinity && isAxis)) {
        best = { reach, from, angle, range: rays.max_range[ray] };
      }
    }
    const length = Math.min(best.reach, best.range);
    cast.x.push(best.from[0] + length * Math.cos(best.angle));
    cast.y.push(best.from[1] + length * Math.sin(best.angle));
    cast.hit.push(best.reach < Infinity);
  }
  return cast;
}

/** The walls whose boxes come as near as `far`. */
function nearWalls(walls, x, y, far) {
  const found = [];
  for (let i = 0; i < walls.length; i += 4) {
    const [ax, ay, bx, by] = [walls[i], walls[i + 1], walls[i + 2], walls[i + 3]];
    if (Math.min(ax, bx) <= x + far && Math.max(ax, bx) >= x - far && Math.min(ay, by) <= y + far && Math.max(ay, by) >= y - far) {
      found.push(ax, ay, bx, by);
    }
  }
  return Float64Array.from(found);
}

/** First hit of a ray: distance, and the angle between the ray and the wall's normal. */
function castRay(walls, x, y, angle) {
  const [dx, dy] = [Math.cos(angle), Math.sin(angle)];
  let distance = Infinity, cosine = 1;
  for (let i = 0; i < walls.length; i += 4) {
    const ex = walls[i + 2] - walls[i], ey = walls[i + 3] - walls[i + 1];
    const across = dx * ey - dy * ex;
    if (across === 0) continue;
    const px = walls[i] - x, py = walls[i + 1] - y;
    const along = (px * ey - py * ex) / across;
    if (along < 0 || along >= distance) continue;
    const share = (px * dy - py * dx) / across;
    if (share < -1e-6 || share > 1 + 1e-6) continue;
    distance = along;
    cosine = Math.abs(across) / Math.hypot(ex, ey);
  }
  return { distance, incidence: Math.acos(Math.min(cosine, 1)) };
}
