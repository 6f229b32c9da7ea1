"use strict";
// A material under one directional light of irradiance π, seen from above: ops.microfacet, texel by texel.

const MATERIAL_VERTEX = `
attribute vec2 corner; varying vec2 at;
void main() { at = vec2(corner.x + 1.0, 1.0 - corner.y) / 2.0; gl_Position = vec4(corner, 0.0, 1.0); }`;
const MATERIAL_FRAGMENT = `
precision highp float;
varying vec2 at; // from the left and from the top, 0 to 1
uniform sampler2D colours, reliefs, tints; uniform vec3 light; uniform float aspect, albedo, eta, camera, tinted;
const float TINY = 1e-6, PI = 3.14159265358979;
float smithOverCos(float c, float m) {
  c = max(c, TINY);
  float slope = m * sqrt(max(1.0 - c * c, TINY * TINY)), a = c / slope;
  return a < 1.6 ? (3.535 + 2.181 * a) / (slope * (1.0 + 2.276 * a + 2.577 * a * a)) : 1.0 / c;
}
vec3 schlick(float c, vec3 f0, vec3 f90) { return f0 + (f90 - f0) * pow(clamp(1.0 - c, 0.0, 1.0), 5.0); }
void main() {
  vec4 colour = texture2D(colours, at), relief = texture2D(reliefs, at), tint = texture2D(tints, at);
  vec3 kd = colour.rgb * colour.rgb, n = normalize((255.0 * relief.rgb - 128.0) / 127.0);
  vec3 ks = mix(vec3(colour.a * colour.a), tint.rgb * tint.rgb, tinted);
  float m = max(relief.a * relief.a, 1e-3);
  vec3 o = normalize(vec3(0.0, 0.0, camera) - vec3(at.x - 0.5, (0.5 - at.y) * aspect, 0.0)), h = normalize(light + o);
  float ci = dot(n, light), co = dot(n, o), ch = dot(n, h), oh = dot(o, h);
  float normalF0 = (eta - 1.0) / (eta + 1.0);
  vec3 f0 = mix(vec3(normalF0 * normalF0), ks, albedo), f90 = mix(vec3(1.0), min(ks / 0.04, 1.0), albedo);
  vec3 scale = mix(ks, vec3(1.0), albedo);
  vec3 across = cross(n, h);
  float tan2 = min(dot(across, across) / max(ch * ch, TINY * TINY), 1e8);
  float facets = exp(-tan2 / (m * m)) * (1.0 + tan2) * (1.0 + tan2) / (PI * m * m);
  vec3 lobe = ci > 0.0 && co > TINY
    ? scale / 4.0 * facets * smithOverCos(ci, m) * smithOverCos(co, m) * schlick(oh, f0, f90) * ci : vec3(0.0);
  vec3 base = kd * mix(vec3(1.0), max(1.0 - schlick(abs(co), f0, f90), 0.0), albedo);
  vec3 radiance = base * max(ci, 0.0) + PI * lobe;
  gl_FragColor = vec4(min(pow(max(radiance, 0.0), vec3(1.0 / 2.2)), 1.0), 1.0);
}`;

// The same for one texel, without WebGL: colour, relief and tint (if any) are its four bytes each, at is as above.
function shadeTexel(colour, relief, tint, at, light, aspect, model) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const unit = (v) => { const s = Math.sqrt(dot(v, v)); return v.map((x) => x / s); };
  const smithOverCos = (cos, m) => {
    const c = Math.max(cos, 1e-6), slope = m * Math.sqrt(Math.max(1 - c * c, 1e-12)), a = c / slope;
    return a < 1.6 ? (3.535 + 2.181 * a) / (slope * (1 + 2.276 * a + 2.577 * a * a)) : 1 / c;
  };
  const schlick = (c, f0, f90) => f0 + (f90 - f0) * Math.min(Math.max(1 - c, 0), 1) ** 5;
  const kd = [0, 1, 2].map((k) => (colour[k] / 255) ** 2);
  const n = unit([0, 1, 2].map((k) => (relief[k] - 128) / 127)), m = Math.max((relief[3] / 255) ** 2, 1e-3);
  const o = unit([0.5 - at[0], (at[1] - 0.5) * aspect, model.distance]);
  const h = unit([0, 1, 2].map((k) => light[k] + o[k]));
  const ci = dot(n, light), co = dot(n, o), ch = dot(n, h), oh = dot(o, h);
  const normal = ((model.eta - 1) / (model.eta + 1)) ** 2;
  const across = [n[1] * h[2] - n[2] * h[1], n[2] * h[0] - n[0] * h[2], n[0] * h[1] - n[1] * h[0]];
  const tan2 = Math.min(dot(across, across) / Math.max(ch * ch, 1e-12), 1e8);
  const facets = (Math.exp(-tan2 / (m * m)) * (1 + tan2) ** 2) / (Math.PI * m * m);
  const seen = ci > 0 && co > 1e-6;
  const facing = seen ? (facets / 4) * smithOverCos(ci, m) * smithOverCos(co, m) * ci : 0;
  return kd.map((k, c) => {
    const ks = ((tint ? tint[c] : colour[3]) / 255) ** 2;
    const [scale, f0, f90] = model.albedo ? [1, ks, Math.min(ks / 0.04, 1)] : [ks, normal, 1];
    const kept = model.albedo ? Math.max(1 - schlick(Math.abs(co), f0, f90), 0) : 1;
    return Math.min((k * kept * Math.max(ci, 0) + Math.PI * scale * facing * schlick(oh, f0, f90)) ** (1 / 2.2), 1);
  });
}

function lightWithGl(canvas, gl, data) {
  const made = program(gl, MATERIAL_VERTEX, MATERIAL_FRAGMENT);
  const at = (name) => gl.getUniformLocation(made, name);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(gl.getAttribLocation(made, "corner"));
  gl.vertexAttribPointer(gl.getAttribLocation(made, "corner"), 2, gl.FLOAT, false, 0, 0);
  const textures = [gl.createTexture(), gl.createTexture(), gl.createTexture()];
  ["colours", "reliefs", "tints"].forEach((name, k) => gl.uniform1i(at(name), k));
  gl.uniform1f(at("aspect"), data.height / data.width);
  gl.uniform1f(at("albedo"), data.model.albedo ? 1 : 0);
  gl.uniform1f(at("eta"), data.model.eta);
  gl.uniform1f(at("camera"), data.model.distance);
  return {
    load(item) {
      gl.uniform1f(at("tinted"), item.tint ? 1 : 0);
      [item.colour, item.relief, item.tint || item.colour].forEach((bytes, k) => {
        gl.activeTexture(gl.TEXTURE0 + k);
        gl.bindTexture(gl.TEXTURE_2D, textures[k]);
        const values = unpack(bytes, Uint8Array);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, data.width, data.height, 0, gl.RGBA, gl.UNSIGNED_BYTE, values);
        for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
        for (const scale of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, scale, gl.LINEAR);
      });
    },
    draw(light) {
      const side = fitted(canvas);
      gl.viewport(0, 0, side, side);
      gl.uniform3fv(at("light"), light);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    },
  };
}

function lightOnCanvas(canvas, data) {
  const context = canvas.getContext("2d");
  const { width, height, model } = data;
  let maps = [];
  return {
    load(item) { maps = [item.colour, item.relief, item.tint].map((bytes) => bytes && unpack(bytes, Uint8Array)); },
    draw(light) {
      [canvas.width, canvas.height] = [width, height];
      const picture = context.createImageData(width, height);
      for (let p = 0; p < width * height; p++) {
        const at = [((p % width) + 0.5) / width, (Math.floor(p / width) + 0.5) / height];
        const here = maps.map((map) => map && map.subarray(4 * p, 4 * p + 4));
        const seen = shadeTexel(...here, at, light, height / width, model);
        picture.data.set([...seen.map((v) => 255 * v), 255], 4 * p);
      }
      context.putImageData(picture, 0, 0);
    },
  };
}

// The light is above the point (x, y) of the tile, the middle 0 and the edges ±1.
function lightAbove(x, y) {
  const length = Math.hypot(x, y, 0.8);
  return [x / length, y / length, 0.8 / length];
}

// A canvas whose light follows a hand; lit(degrees) is called with its angle from the normal.
function materialView(canvas, data, lit = () => {}) {
  const gl = canvas.getContext("webgl", { alpha: false, preserveDrawingBuffer: true });
  const drawing = gl ? lightWithGl(canvas, gl, data) : lightOnCanvas(canvas, data);
  let [x, y, time, stop] = [-0.6, 0.6, 0, () => {}];
  const draw = () => {
    const light = lightAbove(x, y);
    drawing.draw(light);
    lit(Math.round((Math.acos(light[2]) * 180) / Math.PI));
  };
  const follow = (event) => {
    stop();
    const box = canvas.getBoundingClientRect();
    [x, y] = [(2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height];
    draw();
  };
  canvas.addEventListener("pointermove", follow);
  canvas.addEventListener("pointerdown", follow);
  onArrows(canvas, (right, up) => {
    stop();
    [x, y] = [Math.min(Math.max(x + 0.15 * right, -3), 3), Math.min(Math.max(y + 0.15 * up, -3), 3)];
    draw();
  });
  addEventListener("resize", draw);
  return {
    show(item) { drawing.load(item); draw(); },
    spin() {
      if (gl) stop = idle((seconds) => {
        time += seconds;
        [x, y] = [0.85 * Math.cos(2.36 - 0.6 * time), 0.85 * Math.sin(2.36 - 0.6 * time)];
        draw();
      });
    },
    close() { stop(); removeEventListener("resize", draw); },
  };
}

function showMaterials(data, canvas, buttons, note) {
  const view = materialView(canvas, data, (degrees) => { note.textContent = `light ${degrees}° from the normal`; });
  chooser(buttons, data.items, (k) => view.show(data.items[k]));
  view.spin();
}
