// Explore: turn a sample, move it along the directions in which samples differ most, go from one pick to another.
import { ask, keep, latest, link, make, say } from "/assets/app.js";
import { newerWeights, title, withRun } from "/assets/choose.js";
import { exportBar, pictureButton } from "/assets/export.js";

export const explorePanel = (root, query) => withRun(root, query, "explore", ["volumes", "images", "maps", ""], explore);

// All that is shown and downloaded is of one step's weights, which the address names, however far training goes meanwhile.
function explore(root, query, name) {
  const place = {
    step: query.step === undefined ? null : Number(query.step),
    pick: Number(query.pick || 0), other: query.other === undefined ? null : Number(query.other), mix: Number(query.mix || 0),
    truncation: Number(query.truncation ?? 1), slides: (query.slides || "").split(",").map((v) => Number(v) || 0),
  };
  const asked = () => ({
    run: query.run, step: place.step, pick: place.pick, other: place.other, mix: place.other === null ? null : place.mix,
    truncation: place.truncation, slides: place.slides.some(Boolean) ? place.slides.join(",") : "",
  });
  const stage = make("div.stage"), note = make("p.small", "drawing …"), light = make("p", { hidden: true }, make("a", "Light it")), controls = make("div.controls"), grid = make("div.picks");
  const newer = newerWeights(query.run, () => place.step);
  root.append(title(query.run), newer.bar, make("div.explorer", make("section", stage, note, light, make("h2", "Samples"), grid), make("section", controls)));
  const view = stageView(stage, query);

  const draw = latest(async () => {
    const began = performance.now();
    const found = await ask("/api/sample", asked());
    if (place.step === null) { place.step = found.step; keep({ step: found.step }); }
    view.show(found);
    light.hidden = found.kind !== "materials";
    light.firstChild.href = link("materials", asked());
    const about = found.kind === "shapes" ? `${found.items[0].triangles.toLocaleString("en")} triangles, ` : "";
    note.textContent = `Sample ${place.pick} of step ${found.step.toLocaleString("en")}: ${about}drawn in ${Math.round(performance.now() - began)} ms. ${found.kind === "picture" ? "" : HOW[found.kind]}`;
  });
  function changed() {
    const { run, ...kept } = asked();
    keep({ ...kept, truncation: place.truncation === 1 ? "" : place.truncation });
    draw(null);
  }
  fillControls(controls, place, changed);
  let closed = false;
  draw(null).then(() => closed ? null : fillGrid(grid, query, place, changed)).then((found) => {
    if (closed) return;
    const bar = exportBar(found.formats, found.format, "/api/export", asked);
    bar.append(pictureButton(() => stage.querySelector("canvas, img"), () => `${name}-${String(place.pick).padStart(2, "0")}-view`));
    controls.append(make("h2", "Export"), bar);
  }).catch(say);
  return () => { closed = true; newer.stop(); view.close(); };
}

const HOW = { shapes: "Drag it, or arrow keys.", materials: "Point at it to move the light, or arrow keys." };

// What shows a mesh, a material or a picture, whichever comes.
export function stageView(stage, query) {
  let shown = null, kind = "";
  const angles = [Number(query.azimuth ?? 35), Number(query.elevation ?? 20)].map((degrees) => (degrees * Math.PI) / 180);
  let timer;
  const turned = (...now) => {
    [angles[0], angles[1]] = now;
    clearTimeout(timer); // browsers refuse more than a few changes of the address a second
    timer = setTimeout(() => keep({ azimuth: Math.round((now[0] * 180) / Math.PI), elevation: Math.round((now[1] * 180) / Math.PI) }), 250);
  };
  return {
    show(found) {
      if (found.kind !== kind) {
        kind = found.kind;
        if (shown && shown.close) shown.close();
        shown = null;
        stage.replaceChildren(kind === "picture" ? make("img.pixels", { alt: "a sample" })
          : make(kind === "materials" ? "canvas.tile" : "canvas", { tabIndex: 0, role: "img", "aria-label": "a sample" }));
        if (kind === "shapes") { shown = shapeView(stage.firstChild, turned); }
        if (kind === "materials") { shown = materialView(stage.firstChild, found); }
      }
      if (kind === "picture") stage.firstChild.src = found.picture;
      else shown.show(found.items[0]);
      if (kind === "shapes") { const [a, e] = angles; shown.turnTo(a, e); }
    },
    // Looks from a view in degrees.
    face({ azimuth, elevation }) {
      [angles[0], angles[1]] = [azimuth, elevation || 0].map((degrees) => (degrees * Math.PI) / 180);
      if (kind === "shapes" && shown) shown.turnTo(...angles);
    },
    close() { clearTimeout(timer); if (shown && shown.close) shown.close(); },
  };
}

function slider(label, value, low, high, step, moved) {
  const input = make("input", { type: "range", min: low, max: high, step, value });
  const shown = make("output", String(value));
  input.oninput = () => { shown.textContent = input.value; moved(Number(input.value)); };
  return { row: make("label.slider", make("span", label), input, shown), input, shown };
}

function fillControls(controls, place, changed) {
  const sliders = Array.from({ length: 8 }, (_, k) =>
    slider(`direction ${k + 1}`, place.slides[k] || 0, -3, 3, 0.05, (value) => {
      for (let i = 0; i <= k; i++) place.slides[i] ||= 0;
      place.slides[k] = value;
      changed();
    }));
  for (const { row } of sliders) row.classList.add("direction");
  const truncation = slider("truncation", place.truncation, 0, 1, 0.01, (value) => { place.truncation = value; changed(); });
  truncation.row.title = "1: as it was generated. 0: the mean of all.";
  const mix = slider("mix of both", place.mix, 0, 1, 0.01, (value) => { place.mix = value; changed(); });
  mix.row.id = "mix";
  mix.row.hidden = place.other === null;
  const reset = make("button", { type: "button", title: "key R" }, "Reset");
  reset.dataset.key = "r";
  reset.onclick = () => {
    place.slides = [];
    place.truncation = 1;
    for (const { input, shown } of sliders) { input.value = 0; shown.textContent = "0"; }
    truncation.input.value = 1;
    truncation.shown.textContent = "1";
    changed();
  };
  const says = make("p.small", "The directions in which samples differ most, the first most of all, in standard deviations from the pick. Truncation 1 is as it was generated, 0 the mean of all samples.");
  controls.append(make("h2", "Change it"), says, mix.row, ...sliders.map((one) => one.row), truncation.row, make("div.bar", reset));
}

const PAGE = 24; // samples a page of the grid, as the server has it

export async function fillGrid(grid, query, place, changed) {
  const second = make("button", { type: "button", "aria-pressed": "false" }, "Go towards another");
  const pages = make("span"), cells = make("div.cells"), steps = ["p", "n"].map((key) => make("button", { type: "button", title: `key ${key.toUpperCase()}`, "aria-label": key === "n" ? "next sample" : "sample before" }, key === "n" ? "→" : "←"));
  const hint = make("span.small", { role: "status" }), bar = make("div.bar", ...steps, second, hint, pages);
  let total = PAGE, at = 0;
  steps.forEach((button, k) => {
    button.dataset.key = "pn"[k];
    button.onclick = async () => {
      place.pick = (place.pick + (k ? 1 : -1) + total) % total;
      const wanted = Math.floor(place.pick / PAGE);
      if (wanted !== at) await page(wanted).catch(say);
      end();
    };
  });
  grid.append(bar, cells);
  const mix = document.getElementById("mix");
  const mark = () => cells.querySelectorAll("button").forEach((cell) => {
    cell.setAttribute("aria-pressed", String(Number(cell.value) === place.pick));
    cell.classList.toggle("other", Number(cell.value) === place.other);
  });
  const press = (on) => {
    second.setAttribute("aria-pressed", String(on));
    hint.textContent = on ? "Now choose the sample below that it should go to." : "";
  };
  second.onclick = () => {
    if (place.other === null) { press(second.getAttribute("aria-pressed") !== "true"); return; }
    [place.other, place.mix] = [null, 0];
    end();
  };
  function end() {
    press(false);
    mix.hidden = place.other === null;
    mix.querySelector("input").value = place.mix;
    mix.querySelector("output").textContent = String(place.mix);
    second.textContent = place.other === null ? "Go towards another" : "End the way between two";
    mark();
    changed();
  }
  function pick(number) {
    if (second.getAttribute("aria-pressed") === "true") [place.other, place.mix] = [number, 0.5];
    else place.pick = number;
    end();
  }
  async function page(k) {
    const found = await ask("/api/grid", { run: query.run, step: place.step, page: k });
    [total, at] = [found.pages * found.samples.length, k];
    document.querySelectorAll(".direction").forEach((row, i) => { row.hidden = i >= found.sliders; });
    cells.replaceChildren(...found.samples.map((sample) => {
      const cell = make("button", { type: "button", value: sample.pick, title: `sample ${sample.pick}` },
        make("img", { src: sample.picture, alt: `sample ${sample.pick}` }));
      cell.onclick = () => pick(sample.pick);
      return cell;
    }));
    pages.replaceChildren(...Array.from({ length: found.pages }, (_, i) => {
      const button = make("button", { type: "button", "aria-pressed": String(i === k), "aria-label": `page ${i + 1} of samples` }, String(i + 1));
      button.onclick = () => page(i).catch(say);
      return button;
    }));
    mark();
    return found;
  }
  if (place.other !== null) second.textContent = "End the way between two";
  return page(Math.floor(place.pick / PAGE));
}
