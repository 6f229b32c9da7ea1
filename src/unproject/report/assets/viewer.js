"use strict";
// What both viewers share: the data of the page, the canvas, the buttons that choose a sample, and how a hand moves.

function unpack(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Kind(bytes.buffer); // all browsers' machines are little-endian, as the data are
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  gl.useProgram(made);
  return made;
}

// Buttons "1" to "8" that call choose(k); the first is chosen.
function chooser(place, items, choose) {
  const buttons = items.map((item, k) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = item.name.replace(/^sample /, "");
    button.setAttribute("aria-label", item.name);
    button.addEventListener("click", () => pick(k));
    place.append(button);
    return button;
  });
  function pick(k) {
    buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(i === k)));
    choose(k);
  }
  pick(0);
}

// Calls frame(seconds) while nobody has touched the canvas, unless the reader wants no motion; returns what stops it.
function idle(frame) {
  let going = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  let before = performance.now();
  function next(now) {
    if (!going) return;
    frame(Math.min((now - before) / 1000, 0.1));
    before = now;
    requestAnimationFrame(next);
  }
  if (going) requestAnimationFrame(next);
  return () => { going = false; };
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

// Calls move(right, up) with the arrow pressed.
function onArrows(canvas, move) {
  canvas.addEventListener("keydown", (event) => {
    const by = ARROWS[event.key];
    if (!by) return;
    event.preventDefault();
    move(by[0], by[1]);
  });
}

function fitted(canvas) {
  const side = Math.max(1, Math.round(canvas.clientWidth * Math.min(devicePixelRatio || 1, 2)));
  if (canvas.width !== side) canvas.width = canvas.height = side;
  return side;
}
