// The camera: an eye, a target, what is up, and a vertical field of view in degrees or, of
// orthographic views, a visible height, as surfel-render takes them. Camera space has x right, y
// down and z forward.

import { add, anyAcross, cross, dot, length, normalized, scale, subtract, times, turned } from 'surfel/vector.js';

export class Camera {
  constructor({ eye, target, up, fov, ortho = 0 }) {
    this.eye = [...eye];
    this.target = [...target];
    this.up = normalized(up);
    this.fov = fov;
    this.ortho = ortho; // Visible height; 0: perspective.
  }

  copy() {
    return new Camera(this);
  }

  forward() {
    return normalized(subtract(this.target, this.eye));
  }

  distance() {
    return length(subtract(this.target, this.eye));
  }

  /** Rows of the rotation into camera space. */
  rotation() {
    const forward = this.forward();
    let right = cross(forward, this.up);
    right = length(right) > 1e-9 ? normalized(right) : anyAcross(forward);
    return [right, cross(forward, right), forward];
  }

  /** Pixels per scene unit at depth 1, or at all depths. */
  focal(height) {
    if (this.ortho > 0) return height / this.ortho;
    return height / (2 * Math.tan((this.fov * Math.PI) / 360));
  }

  /** Scene units of a pixel at a depth. */
  pixelAt(depth, height) {
    return (this.ortho > 0 ? 1 : depth) / this.focal(height);
  }

  /** Changes the projection; the target stays as large. */
  project(orthographic) {
    if (orthographic === this.ortho > 0) return;
    const height = 2 * Math.tan((this.fov * Math.PI) / 360);
    if (orthographic) {
      this.ortho = height * this.distance();
      return;
    }
    const wanted = this.ortho / height;
    this.ortho = 0;
    this.dolly(wanted / this.distance());
  }

  /** Turns the eye about the target: to the right, and up, radians. The poles are not passed. */
  orbit(toRight, toTop) {
    const back = subtract(this.eye, this.target);
    this.eye = add(this.target, this.tilted(back, toRight, toTop));
  }

  /** Turns the view about the eye. */
  look(toRight, toTop) {
    const ahead = subtract(this.target, this.eye);
    this.target = add(this.eye, this.tilted(ahead, -toRight, toTop));
  }

  tilted(arm, aroundUp, toTop) {
    const size = length(arm);
    const turnedArm = turned(arm, this.up, aroundUp);
    const angle = Math.asin(Math.max(-1, Math.min(1, dot(turnedArm, this.up) / size)));
    const most = Math.PI / 2 - 0.001;
    const wanted = Math.max(-most, Math.min(most, angle + toTop));
    const axis = cross(turnedArm, this.up);
    if (!(length(axis) > 1e-9 * size)) return turnedArm;
    return turned(turnedArm, normalized(axis), wanted - angle);
  }

  /** Moves eye and target: to the right, up on the screen, and ahead, scene units. */
  move(right, up, ahead) {
    const [x, y, z] = this.rotation();
    const by = add(add(scale(x, right), y, -up), z, ahead);
    this.eye = add(this.eye, by);
    this.target = add(this.target, by);
  }

  /** Brings the eye nearer to the target by a factor below 1, or takes it away; or shows less, or more. */
  dolly(factor) {
    if (this.ortho > 0) {
      this.ortho *= factor;
      return;
    }
    this.eye = add(this.target, subtract(this.eye, this.target), factor);
  }

  /** A point in camera space. */
  inCamera(point) {
    return times(this.rotation(), subtract(point, this.eye));
  }

  /** The camera as numbers of an address. */
  text() {
    const numbers = [...this.eye, ...this.target, ...this.up, this.fov];
    if (this.ortho > 0) numbers.push(this.ortho);
    return numbers.map(shortNumber).join(',');
  }

  static fromText(text) {
    const n = text.split(',').map(Number);
    if (n.length < 10 || n.length > 11 || !n.every(Number.isFinite)) return null;
    return new Camera({
      eye: n.slice(0, 3), target: n.slice(3, 6), up: n.slice(6, 9), fov: n[9], ortho: Math.max(0, n[10] ?? 0),
    });
  }
}

/** A number with the digits that matter to a picture. */
export function shortNumber(value) {
  return String(Number(value.toPrecision(9)));
}
