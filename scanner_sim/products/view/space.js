"use strict";
// The space of a page: points and lines, the camera and its views, labels, and which point lies under the pointer.

const POINT_VERTEX = `
attribute vec4 colour; uniform float size; uniform float pitch; uniform float focal; uniform float wider; varying vec4 shade;
void main() {
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  shade = colour;
  gl_Position = projectionMatrix * seen;
  gl_PointSize = clamp(wider * size * focal * pitch * length(position) / max(-seen.z, 1e-6), 1.5, 64.0);
}`;
const POINT_FRAGMENT = `
varying vec4 shade;
void main() { vec2 away = gl_PointCoord - 0.5; if (dot(away, away) > 0.27) discard; gl_FragColor = vec4(shade.rgb, 1.0); }`;

const COARSE = 0.5; // dots of a moving picture for each of one at rest, where the processor draws

/** Return whether a graphics card draws, and not the processor: asked by name, since browsers call both able. */
function hasCard() {
  const gl = document.createElement("canvas").getContext("webgl2"), about = gl?.getExtension("WEBGL_debug_renderer_info");
  return !/swiftshader|llvmpipe|softpipe|basic render/i.test(about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "");
}

class Space {
  constructor(host) {
    this.host = host;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(35, 1, 0.01, 1000);
    this.camera.up.set(0, -1, 0); // y points down in the scanner's frame
    this.labels = [];
    this.clouds = [];
    this.wanted = false;
    this.moving = false;
    this.card = hasCard();
    this.pace = new Pace(this.card ? 1 : 0.1);
    this.middle = new THREE.Vector3(0, 0, 1);
    this.extent = 1;
    this.radius = 1;
    try {
      // Smooth edges take a processor three times as long.
      this.renderer = new THREE.WebGLRenderer({ antialias: this.card, preserveDrawingBuffer: true });
    } catch {
      byId("trouble").textContent = "This browser gives no WebGL 2: the points cannot be turned here. Picture and numbers at the side are whole.";
      byId("trouble").hidden = false;
      return;
    }
    this.renderer.domElement.className = "gl";
    host.prepend(this.renderer.domElement);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.moved());
    this.controls.zoomToCursor = true;
    new ResizeObserver(() => this.resize()).observe(host);
    dark.addEventListener("change", () => this.theme());
  }

  /** Add points, flat positions [m] and four bytes of colour each; those without alpha are hidden. */
  addPoints(positions, pitch) {
    const geometry = new THREE.BufferGeometry();
    // What lies nowhere is hidden, but drivers differ in what they make of NaN.
    geometry.setAttribute("position", new THREE.BufferAttribute(positions.map((value) => (Number.isFinite(value) ? value : 0)), 3));
    const colours = new Uint8Array((positions.length / 3) * 4);
    geometry.setAttribute("colour", new THREE.BufferAttribute(colours, 4, true));
    const order = shuffled(positions.length / 3);
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(order.length), 1));
    const uniforms = { size: { value: 1 }, wider: { value: 1 }, pitch: { value: pitch }, focal: { value: 1 } };
    const material = new THREE.ShaderMaterial({ vertexShader: POINT_VERTEX, fragmentShader: POINT_FRAGMENT, uniforms });
    const points = new THREE.Points(geometry, material);
    points.frustumCulled = false;
    this.scene.add(points);
    const cloud = { positions, colours, geometry, uniforms, points, order, shown: 0 };
    this.clouds.push(cloud);
    return cloud;
  }

  /** Say that colours of a cloud have changed. */
  changed(cloud) {
    const { geometry, order, colours } = cloud;
    cloud.shown = indexShown(order, colours, geometry.index.array);
    geometry.index.needsUpdate = geometry.attributes.colour.needsUpdate = true;
    this.draw();
  }

  /** Add pairs of points as lines in a colour of the style sheet, or of its own "#rrggbb". */
  addLines(positions, colour, opacity = 1) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    const material = new THREE.LineBasicMaterial({ transparent: opacity < 1, opacity });
    const lines = new THREE.LineSegments(geometry, material);
    lines.frustumCulled = false;
    lines.userData.colour = colour;
    this.paint(lines);
    this.scene.add(lines);
    return lines;
  }

  /** Replace the points of lines; there must be as many. */
  move(lines, positions) {
    lines.geometry.attributes.position.array.set(positions);
    lines.geometry.attributes.position.needsUpdate = true;
  }

  paint(lines) {
    const colour = lines.userData.colour;
    lines.material.color.set(colour.startsWith("--") ? colourOf(colour) : colour);
  }

  addLabel(text, at, className = "") {
    const label = { element: el("span", { className }, text), at: new THREE.Vector3(...at) };
    byId("labels").append(label.element);
    this.labels.push(label);
    return label;
  }

  theme() {
    if (!this.renderer) return;
    this.renderer.setClearColor(colourOf("--space"));
    this.scene.traverse((one) => one.userData.colour && this.paint(one));
    this.draw();
  }

  resize() {
    const { clientWidth: wide, clientHeight: high } = this.host;
    if (!this.renderer || !wide || !high) return;
    const dots = window.devicePixelRatio * (this.moving && !this.card ? COARSE : 1);
    this.renderer.setPixelRatio(dots);
    this.renderer.setSize(wide, high, false);
    this.camera.aspect = wide / high;
    this.camera.updateProjectionMatrix();
    const focal = (0.5 * high * dots) / Math.tan((0.5 * this.camera.fov * Math.PI) / 180);
    for (const cloud of this.clouds) cloud.uniforms.focal.value = focal;
    this.draw();
  }

  /** The camera moves: draw, with fewer points where frames are slow, and all of them once it rests. */
  moved() {
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.goOrRest(false), 250);
    if (this.moving) this.draw();
    else this.goOrRest(true);
  }

  goOrRest(moving) {
    this.moving = moving;
    this.resize(); // where the processor draws, its moving pictures are coarser
  }

  /** Draw all points, or while the camera moves such a share of them that a frame takes no longer than it may. */
  drawPoints() {
    const start = performance.now(), share = this.moving ? this.pace.share : 1;
    for (const { geometry, uniforms, shown } of this.clouds) {
      const { drawn, wider } = thinned(shown, share);
      geometry.setDrawRange(0, drawn);
      uniforms.wider.value = wider;
    }
    this.renderer.render(this.scene, this.camera);
    if (!this.moving) return;
    // Asking for a dot waits for the picture: else its cost is seen some frames later, and frames queue up.
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    this.pace.took(performance.now() - start);
  }

  /** Draw once before the next frame of the screen: nothing is drawn while nothing changes. */
  draw() {
    if (this.wanted || !this.renderer) return;
    this.wanted = true;
    requestAnimationFrame(() => {
      this.wanted = false;
      this.render();
    });
  }

  render() {
    this.drawPoints();
    const { clientWidth: wide, clientHeight: high } = this.host;
    const at = new THREE.Vector3();
    for (const label of this.labels) {
      at.copy(label.at).project(this.camera);
      const seen = !label.hidden && at.z < 1 && Math.abs(at.x) < 1.02 && Math.abs(at.y) < 1.02;
      label.element.hidden = !seen;
      if (!seen) continue;
      label.element.style.left = `${0.5 * (at.x + 1) * wide}px`;
      label.element.style.top = `${0.5 * (1 - at.y) * high}px`;
    }
  }

  /** Learn where points lie, by their quantiles: a stray one moves no view. */
  surround(positions, shown) {
    const axes = [[], [], []];
    const every = Math.max(1, Math.floor(positions.length / 3 / 20000));
    for (let i = 0; i < positions.length / 3; i += every)
      if (shown(i)) for (let axis = 0; axis < 3; axis++) axes[axis].push(positions[3 * i + axis]);
    if (!axes[0].length) return;
    const ends = axes.map((values) => values.sort((a, b) => a - b)).map((values) => [values[Math.floor(0.02 * values.length)], values[Math.floor(0.98 * (values.length - 1))]]);
    this.middle.set(...ends.map(([low, high]) => 0.5 * (low + high)));
    this.radius = 0.5 * Math.hypot(...ends.map(([low, high]) => high - low)) || 0.05 * this.middle.length();
    this.extent = Math.max(0.05 * this.middle.length(), ...ends.map(([low, high]) => high - low));
  }

  /** Look from the scanner, the top, the side, or aslant at all. */
  look(from) {
    const { camera, controls, middle } = this;
    if (!controls) return;
    const away = (0.9 * this.radius) / Math.sin((0.5 * 35 * Math.PI) / 180) / Math.min(1, camera.aspect);
    const ways = { top: [0, -1, -0.001], side: [1, 0, 0], all: [0.62, -0.42, -0.66] };
    camera.near = 1e-3 * Math.max(this.extent, 0.05 * middle.length());
    camera.far = 50 * (this.extent + middle.length());
    controls.target.copy(middle);
    if (from === "scanner") camera.position.copy(middle).setLength(1e-3 * middle.length());
    else camera.position.copy(middle).addScaledVector(new THREE.Vector3(...ways[from]).normalize(), away);
    camera.fov = 35;
    if (from === "scanner") camera.fov = Math.min(100, (360 / Math.PI) * Math.atan((0.62 * this.extent) / middle.length()));
    camera.updateProjectionMatrix();
    this.resize();
    controls.update();
    this.draw();
  }

  /** Turn about the middle by angles [rad], or come nearer by a factor. */
  turn(across, up, nearer = 1) {
    const { camera, controls } = this;
    if (!controls) return;
    const arm = camera.position.clone().sub(controls.target);
    const right = new THREE.Vector3().crossVectors(camera.up, arm).normalize();
    arm.applyAxisAngle(camera.up, -across).applyAxisAngle(right, up).multiplyScalar(1 / nearer);
    camera.position.copy(controls.target).add(arm);
    controls.update();
    this.draw();
  }

  /** Return which point of a cloud is nearest to a place on the screen [px], within some pixels; −1 for none. */
  under(cloud, x, y, within = 8) {
    const { clientWidth: wide, clientHeight: high } = this.host;
    const m = this.camera.projectionMatrix.clone().multiply(this.camera.matrixWorldInverse).elements;
    const { positions: p, colours } = cloud;
    let best = -1, nearest = Infinity;
    for (let i = 0, k = 0; k < p.length; i++, k += 3) {
      if (!colours[4 * i + 3]) continue;
      const w = m[3] * p[k] + m[7] * p[k + 1] + m[11] * p[k + 2] + m[15];
      if (w <= 0) continue;
      const dx = 0.5 * ((m[0] * p[k] + m[4] * p[k + 1] + m[8] * p[k + 2] + m[12]) / w + 1) * wide - x;
      const dy = 0.5 * (1 - (m[1] * p[k] + m[5] * p[k + 1] + m[9] * p[k + 2] + m[13]) / w) * high - y;
      const off = dx * dx + dy * dy;
      // Of points that lie together on the screen the one in front: 3 px are worth a fifth of the distance.
      const cost = off > within * within ? Infinity : w * (1 + off / 45);
      if (cost < nearest) [best, nearest] = [i, cost];
    }
    return best;
  }
}
