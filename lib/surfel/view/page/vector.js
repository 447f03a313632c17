// Vectors of three numbers as arrays, and rotations as three rows of them.

export const add = (a, b, t = 1) => [a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]];
export const subtract = (a, b) => add(a, b, -1);
export const scale = (a, t) => [a[0] * t, a[1] * t, a[2] * t];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
export const normalized = (a) => scale(a, 1 / length(a));
export const times = (rows, a) => rows.map((row) => dot(row, a));

/** The vector turned about a unit axis. */
export function turned(a, axis, angle) {
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  const along = scale(axis, dot(axis, a) * (1 - c));
  return add(add(scale(a, c), cross(axis, a), s), along);
}

/** Some unit vector across another. */
export function anyAcross(a) {
  const axis = Math.abs(a[0]) < Math.abs(a[1]) ? [1, 0, 0] : [0, 1, 0];
  return normalized(cross(a, axis));
}
