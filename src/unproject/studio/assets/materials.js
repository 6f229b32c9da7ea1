// Materials: a tile, a plane or a ball under a light; the server's own operator renders it.
import { answerTo, ask, keep, latest, link, make, say, sendable } from "/assets/app.js";
import { newerWeights, title, withRun } from "/assets/choose.js";
import { fillGrid } from "/assets/explore.js";
import { exportBar, store } from "/assets/export.js";

const FORMS = { tile: "Tile", plane: "Plane, 2 × 2", ball: "Ball" };
const LAMPS = ["directional", "coloured"];
const FAST = 8, FINE = 96; // samples a pixel while a hand moves, and once it rests
const turned = (degrees) => ((degrees % 360) + 540) % 360 - 180; // from -180 on, after however many turns
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

export const materialsPanel = (root, query) => withRun(root, query, "materials", ["maps"], materials);

function materials(root, query, name) {
  const given = (name, otherwise) => (query[name] === undefined ? otherwise : Number(query[name]));
  const place = { step: query.step === undefined ? null : Number(query.step), pick: given("pick", 0), other: query.other === undefined ? null : Number(query.other), mix: given("mix", 0), truncation: given("truncation", 1), slides: query.slides || "" };
  const seen = {
    form: query.form || "ball", light: query.light || "studio",
    view: given("view", 60), around: given("around", -90), polar: given("polar", 45), turn: given("turn", 30),
  };
  const image = make("img.rendering", { alt: "the material under a light", width: 256, height: 256, tabIndex: 0, draggable: false });
  const note = make("p.small", "rendering …"), forms = make("div.bar"), lights = make("select", { "aria-label": "light" });
  const maps = make("div.maps"), shape = make("a", "Change it in Explore"), exports = make("div"), grid = make("div.picks");
  const mix = make("label.slider", { id: "mix", hidden: place.other === null }, make("span", "between the picks"),
    make("input", { type: "range", min: 0, max: 1, step: 0.01, value: place.mix }), make("output", String(place.mix)));
  const says = make("p.small", "Drag the picture to move the camera, with Shift or the second button to move the light; or use the arrow keys. Drop an .hdr or .exr here to light it by that.");
  root.append(title(query.run), make("div.explorer", make("section.lit", image, note, forms, make("div.bar", make("label", "Light "), lights), says),
    make("section", make("h2", "Its maps"), maps, make("p", shape), exports)), make("section", make("h2", "Samples"), mix, grid));

  const newer = newerWeights(query.run, () => place.step);
  root.firstChild.after(newer.bar);
  const where = () => ({
    run: query.run, step: place.step, pick: place.pick, other: place.other, mix: place.other === null ? null : place.mix,
    truncation: place.truncation === 1 ? "" : place.truncation, slides: place.slides,
  });
  const render = latest(async (samples) => {
    const began = performance.now();
    const answer = await answerTo("/api/render", { ...where(), ...seen, samples });
    const before = image.src;
    image.src = URL.createObjectURL(await answer.blob());
    await image.decode();
    URL.revokeObjectURL(before);
    const lamp = LAMPS.includes(seen.light) ? `, light ${Math.round(seen.polar)}° from the normal` : "";
    note.textContent = `camera ${Math.round(seen.view)}° from the normal${lamp}; ${Math.round(performance.now() - began)} ms at ${samples} samples a pixel`;
  });
  let rest;
  function look(samples = FAST) {
    render(samples);
    clearTimeout(rest);
    rest = setTimeout(() => {
      if (samples === FAST) render(FINE);
      keep({ ...where(), ...Object.fromEntries(Object.entries(seen).map(([k, v]) => [k, typeof v === "number" ? Math.round(v) : v])) });
    }, 250);
  }
  function changed() {
    look();
    return draw(null);
  }
  const draw = latest(async () => {
    const found = await ask("/api/maps", where());
    shape.href = link("explore", where());
    if (place.step === null) { place.step = found.step; keep({ step: found.step }); }
    maps.replaceChildren(...Object.entries(found.maps).map(([name, uri]) => make("figure", make("img", { src: uri, alt: name }), make("figcaption.small", name))));
    if (!lights.options.length) {
      const dropped = seen.light.startsWith("dropped-") ? [seen.light] : [];
      lights.append(...[...found.lights, ...dropped].map((name) => make("option", { value: name }, name)));
    }
    lights.value = seen.light;
  });
  // The light goes with the hand; the camera the other way, as the material does.
  function move(right, down, ofLight) {
    if (ofLight) {
      seen.turn = turned(seen.turn + right);
      if (LAMPS.includes(seen.light)) seen.polar = clamp(seen.polar + down, 0, 85);
    } else {
      seen.around = turned(seen.around - right);
      seen.view = clamp(seen.view - down, 0, 85);
    }
    look();
  }

  for (const [form, name] of Object.entries(FORMS)) {
    const button = make("button", { type: "button", value: form }, name);
    button.onclick = () => { seen.form = form; mark(); look(); };
    forms.append(button);
  }
  const mark = () => forms.querySelectorAll("button").forEach((button) => button.setAttribute("aria-pressed", String(button.value === seen.form)));
  mark();
  const lamp = make("button", { type: "button", "aria-pressed": "false" }, "Drag the light");
  lamp.onclick = () => lamp.setAttribute("aria-pressed", String(lamp.getAttribute("aria-pressed") !== "true"));
  lights.parentNode.append(lamp);
  lights.onchange = () => { seen.light = lights.value; look(); };
  mix.querySelector("input").oninput = (event) => {
    place.mix = Number(event.target.value);
    mix.querySelector("output").textContent = event.target.value;
    changed();
  };
  let held = null;
  image.addEventListener("contextmenu", (event) => event.preventDefault());
  image.addEventListener("pointerdown", (event) => {
    held = [event.clientX, event.clientY, event.shiftKey || event.button === 2 || lamp.getAttribute("aria-pressed") === "true"];
    image.setPointerCapture(event.pointerId);
  });
  image.addEventListener("pointermove", (event) => {
    if (!held) return;
    const size = image.clientWidth / 150;
    move((event.clientX - held[0]) / size, (event.clientY - held[1]) / size, held[2]);
    [held[0], held[1]] = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) image.addEventListener(end, () => { held = null; });
  image.addEventListener("keydown", (event) => {
    const by = ARROWS[event.key];
    if (!by) return;
    event.preventDefault();
    move(6 * by[0], -6 * by[1], event.shiftKey); // as a hand would drag it
  });
  const drop = async (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (!file) return;
    say(null);
    try {
      const found = await ask("/api/light", { name: file.name }, { method: "POST", body: sendable(file, "for example at 2K") });
      if (![...lights.options].some((option) => option.value === found.light)) lights.append(make("option", { value: found.light }, file.name));
      lights.value = seen.light = found.light;
      look();
    } catch (error) { say(error); }
  };
  const over = (event) => event.preventDefault();
  document.addEventListener("dragover", over);
  document.addEventListener("drop", drop);
  changed().then(() => fillGrid(grid, query, place, changed)).then((found) => {
    const picture = make("button", { type: "button" }, "This rendering as a picture");
    picture.onclick = () => asPng(image).then((blob) => store(blob, `${name.replace(/[^\p{L}\p{N}_.-]+/gu, "-")}-${String(place.pick).padStart(2, "0")}.png`)).catch(say);
    exports.append(make("h2", "Export"), exportBar(found.formats, "maps", "/api/export", where), make("div.bar", picture));
  }).catch(say);
  return () => {
    newer.stop();
    clearTimeout(rest);
    document.removeEventListener("dragover", over);
    document.removeEventListener("drop", drop);
    URL.revokeObjectURL(image.src);
  };
}

function asPng(image) {
  const canvas = make("canvas", { width: image.naturalWidth, height: image.naturalHeight });
  canvas.getContext("2d").drawImage(image, 0, 0);
  return new Promise((done) => canvas.toBlob(done));
}
