// Mouse, touch and keys to cameras: orbit about the target, or fly.

const kTurn = 0.005; // Radians a pixel.

export class Controls {
  /**
   * @param moved  is called when the camera has changed.
   * @param pick   gives the depth of what is seen at a place of the canvas, or 0.
   */
  constructor(canvas, camera, moved, pick) {
    this.canvas = canvas;
    this.camera = camera;
    this.moved = moved;
    this.pick = pick;
    this.fly = false;
    this.pointers = new Map();
    this.keys = new Set();
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.drag(event));
    for (const name of ['pointerup', 'pointercancel']) {
      canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    }
    canvas.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('dblclick', (event) => this.aim(event));
    canvas.addEventListener('keydown', (event) => this.key(event));
    canvas.addEventListener('keyup', (event) => this.keys.delete(event.code));
    canvas.addEventListener('blur', () => this.keys.clear());
  }

  down(event) {
    this.canvas.focus();
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const by = [now[0] - before[0], now[1] - before[1]];
    if (this.pointers.size === 2) {
      this.pinch(event.pointerId, before, now);
    } else if (event.buttons & 6 || event.shiftKey) {
      this.pan(by);
    } else if (this.fly) {
      this.camera.look(by[0] * kTurn, -by[1] * kTurn);
    } else {
      this.camera.orbit(-by[0] * kTurn, by[1] * kTurn);
    }
    this.pointers.set(event.pointerId, now);
    this.moved();
  }

  /** What is under the pointer stays there, at the target's distance. */
  pan([x, y]) {
    const size = this.camera.pixelAt(this.camera.distance(), this.canvas.clientHeight);
    this.camera.move(-x * size, y * size, 0);
  }

  /** Two fingers: their distance is the zoom, their middle moves the scene. */
  pinch(id, before, now) {
    const [other] = [...this.pointers].filter(([key]) => key !== id).map(([, place]) => place);
    const distance = (a) => Math.max(1, Math.hypot(a[0] - other[0], a[1] - other[1]));
    this.camera.dolly(distance(before) / distance(now));
    this.pan([(now[0] - before[0]) / 2, (now[1] - before[1]) / 2]);
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    const by = Math.max(-200, Math.min(200, event.deltaY * lines));
    if (this.fly) {
      this.camera.move(0, 0, (-by / 500) * this.camera.distance());
    } else {
      this.camera.dolly(Math.exp(by / 500));
    }
    this.moved();
  }

  /** The point that was clicked becomes the target. */
  aim(event) {
    const { camera, canvas } = this;
    const depth = this.pick(event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight);
    if (!(depth > 0)) return;
    const size = camera.pixelAt(depth, canvas.clientHeight);
    const [x, y] = [event.offsetX - canvas.clientWidth / 2, event.offsetY - canvas.clientHeight / 2];
    const ahead = depth - camera.distance();
    camera.move(x * size, -y * size, ahead);
    this.moved();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (/^(Key[WASDQE]|Arrow(Up|Down|Left|Right))$/.test(event.code)) {
      event.preventDefault();
      this.keys.add(event.code);
      this.moved();
    }
  }

  /** Moves by the keys that are held; returns whether there are some. */
  advance(seconds) {
    const held = (...codes) => codes.some((code) => this.keys.has(code));
    const axis = (plus, minus) => (held(...plus) ? 1 : 0) - (held(...minus) ? 1 : 0);
    const ahead = axis(['KeyW', 'ArrowUp'], ['KeyS', 'ArrowDown']);
    const right = axis(['KeyD', 'ArrowRight'], ['KeyA', 'ArrowLeft']);
    const up = axis(['KeyE'], ['KeyQ']);
    if (!ahead && !right && !up) return false;
    const step = seconds * 0.7 * this.camera.distance();
    if (this.fly) {
      this.camera.move(right * step, up * step, ahead * step);
    } else {
      this.camera.orbit(right * seconds, up * seconds);
      if (ahead) this.camera.dolly(Math.exp(-ahead * seconds));
    }
    return true;
  }
}
