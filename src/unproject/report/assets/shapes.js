"use strict";
// A shape that can be turned: clay under a light that is fixed to the camera, as the package's own pictures have it.

const CLAY = [0.70, 0.48, 0.36];
const KEY = [-0.4323, 0.7204, 0.5283]; // export.rendering's _KEY_LIGHT

const SHAPE_VERTEX = `
attribute vec3 point, normal; attribute float open;
uniform mat3 camera; uniform float extent; uniform vec3 clay, key;
varying vec3 colour;
void main() {
  vec3 p = camera * point / extent, n = normalize(camera * normal);
  float sky = 0.34 * (0.62 + 0.38 * normal.y) + 0.10 * max(n.z, 0.0);
  float lit = clamp((dot(n, key) + 0.15) / 1.15, 0.0, 1.0);
  colour = clay * (open * sky + 0.95 * lit * (0.5 + 0.5 * open));
  gl_Position = vec4(p.xy, -0.4 * p.z, 1.0);
}`;
const SHAPE_FRAGMENT = `
precision mediump float;
varying vec3 colour;
void main() { gl_FragColor = vec4(pow(min(colour, 1.0), vec3(1.0 / 2.2)), 1.0); }`;

// Rows: the picture's right, its up, and the direction towards the camera (docs/conventions.md).
function cameraAxes(a, e) {
  const [sa, ca, se, ce] = [Math.sin(a), Math.cos(a), Math.sin(e), Math.cos(e)];
  return [[ca, 0, -sa], [-sa * se, ce, -ca * se], [sa * ce, se, ca * ce]];
}

function shapeOf(item) {
  const points = unpack(item.points, Int16Array);
  let extent = 0;
  for (let i = 0; i < points.length; i += 3) extent = Math.max(extent, Math.hypot(points[i], points[i + 1], points[i + 2]));
  return {
    points: Float32Array.from(points, (v) => v / 32767),
    normals: Float32Array.from(unpack(item.normals, Int8Array), (v) => v / 127),
    open: Float32Array.from(unpack(item.open, Uint8Array), (v) => v / 255),
    faces: unpack(item.faces, Uint16Array),
    extent: (1.04 * extent) / 32767 || 1,
  };
}

function drawWithGl(canvas, gl) {
  const made = program(gl, SHAPE_VERTEX, SHAPE_FRAGMENT);
  const at = (name) => gl.getUniformLocation(made, name);
  const buffers = { point: gl.createBuffer(), normal: gl.createBuffer(), open: gl.createBuffer() };
  const faces = gl.createBuffer();
  let count = 0;
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(0, 0, 0, 0);
  gl.uniform3fv(at("clay"), CLAY);
  gl.uniform3fv(at("key"), KEY);
  return {
    load(shape) {
      for (const [name, values, size] of [["point", shape.points, 3], ["normal", shape.normals, 3], ["open", shape.open, 1]]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, buffers[name]);
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
        const where = gl.getAttribLocation(made, name);
        gl.enableVertexAttribArray(where);
        gl.vertexAttribPointer(where, size, gl.FLOAT, false, 0, 0);
      }
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, faces);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, shape.faces, gl.STATIC_DRAW);
      count = shape.faces.length;
      gl.uniform1f(at("extent"), shape.extent);
    },
    draw(axes) {
      const side = fitted(canvas);
      gl.viewport(0, 0, side, side);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const [r, u, d] = axes;
      gl.uniformMatrix3fv(at("camera"), false, [r[0], u[0], d[0], r[1], u[1], d[1], r[2], u[2], d[2]]);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_SHORT, 0);
    },
  };
}

// Without WebGL: triangles from back to front, one colour each.
function drawOnCanvas(canvas) {
  const context = canvas.getContext("2d");
  let shape = null;
  return {
    load(loaded) { shape = loaded; },
    draw(axes) {
      const half = fitted(canvas) / 2;
      const { points, normals, open, faces, extent } = shape;
      const turned = new Float32Array(points.length);
      for (let i = 0; i < points.length; i += 3)
        for (let k = 0; k < 3; k++)
          turned[i + k] = (axes[k][0] * points[i] + axes[k][1] * points[i + 1] + axes[k][2] * points[i + 2]) / extent;
      const order = Array.from({ length: faces.length / 3 }, (_, f) => 3 * f);
      const depth = (f) => turned[3 * faces[f] + 2] + turned[3 * faces[f + 1] + 2] + turned[3 * faces[f + 2] + 2];
      order.sort((a, b) => depth(a) - depth(b));
      context.clearRect(0, 0, 2 * half, 2 * half);
      for (const f of order) {
        const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
        const area = (turned[b] - turned[a]) * (turned[c + 1] - turned[a + 1]) - (turned[c] - turned[a]) * (turned[b + 1] - turned[a + 1]);
        if (area <= 0) continue;
        context.beginPath();
        for (const v of [a, b, c]) context.lineTo(half * (1 + turned[v]), half * (1 - turned[v + 1]));
        context.closePath();
        context.fillStyle = context.strokeStyle = clayAt(normals.subarray(a, a + 3), open[a / 3], axes);
        context.fill();
        context.stroke();
      }
    },
  };
}

function clayAt(n, open, axes) {
  const seen = axes.map((axis) => axis[0] * n[0] + axis[1] * n[1] + axis[2] * n[2]);
  const sky = 0.34 * (0.62 + 0.38 * n[1]) + 0.10 * Math.max(seen[2], 0);
  const lit = Math.min(Math.max((seen[0] * KEY[0] + seen[1] * KEY[1] + seen[2] * KEY[2] + 0.15) / 1.15, 0), 1);
  const light = open * sky + 0.95 * lit * (0.5 + 0.5 * open);
  return `rgb(${CLAY.map((c) => Math.round(255 * Math.min(c * light, 1) ** (1 / 2.2)))})`;
}

// A canvas whose shape a hand turns; turned(azimuth, elevation) is called after each turn.
function shapeView(canvas, turned = () => {}) {
  const gl = canvas.getContext("webgl", { antialias: true, alpha: true, preserveDrawingBuffer: true });
  const drawing = gl ? drawWithGl(canvas, gl) : drawOnCanvas(canvas);
  let [azimuth, elevation, held, loaded, stop] = [0.6, 0.35, null, false, () => {}];
  const draw = () => { if (loaded) drawing.draw(cameraAxes(azimuth, elevation)); };
  function turnTo(a, e) {
    [azimuth, elevation] = [a, Math.min(Math.max(e, -1.5), 1.5)];
    draw();
    turned(azimuth, elevation);
  }
  const turn = (right, up) => turnTo(azimuth - right, elevation + up);
  canvas.addEventListener("pointerdown", (event) => {
    stop();
    held = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    turn((3.2 * (event.clientX - held[0])) / canvas.clientWidth, (3.2 * (event.clientY - held[1])) / canvas.clientWidth);
    held = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
  onArrows(canvas, (right, up) => { stop(); turn(0.15 * right, -0.15 * up); }); // as a hand would drag it
  addEventListener("resize", draw);
  return {
    turnTo,
    show(item) { drawing.load(shapeOf(item)); loaded = true; draw(); },
    spin() { if (gl) stop = idle((seconds) => turn(0.35 * seconds, 0)); },
    close() { stop(); removeEventListener("resize", draw); },
  };
}

function showShapes(data, canvas, buttons, note) {
  const view = shapeView(canvas);
  chooser(buttons, data.items, (k) => {
    view.show(data.items[k]);
    note.textContent = `${data.items[k].triangles.toLocaleString("en")} triangles`;
  });
  view.spin();
}
