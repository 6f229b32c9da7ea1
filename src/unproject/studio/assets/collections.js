// Collections: training pictures by the view that each was assigned, how sure that is, and corrections.
import { ask, keep, make, say } from "/assets/app.js";
import { title, withRun } from "/assets/choose.js";
import { downloadButton } from "/assets/export.js";

export const collectionsPanel = (root, query) => withRun(root, query, "collections", ["volumes", "images", "maps"], collections);

function collections(root, query) {
  const at = { panel: Number(query.panel || 0), view: query.view === undefined ? -1 : Number(query.view), page: Number(query.page || 0) };
  const about = make("p.facts", "reading the pictures …"), panels = make("div.bar"), bars = make("div.views", { role: "group", "aria-label": "views" });
  const how = make("p.small"), table = downloadButton("Download views.csv", "/api/views.csv", () => ({ run: query.run, panel: at.panel }));
  const cells = make("div.cells.pictures"), pages = make("div.bar"), correction = make("section", { hidden: true }), saved = make("p.saved", { hidden: true, role: "status" }), skipped = make("section", { hidden: true });
  const old = make("p.remarks", { hidden: true }, "The views.csv in this run is of a version before, and the run was trained since: which views in it are corrections is not known any more, so that it is not read.");
  const views = make("section", make("h2", "Views"), bars, saved);
  root.append(title(query.run), about, old, panels, views, make("section", make("h2", "Pictures"), how, cells, make("div.bar", pages, table)), correction, skipped);
  let found = null;

  async function collection() {
    found = await ask("/api/collection", { run: query.run, panel: at.panel });
    const several = `${found.labels.length} ${found.labels.length === 1 ? "view" : "views"}${found.views === "predicted" ? ", predicted" : ""}`;
    about.textContent = `${found.pictures.toLocaleString("en")} pictures, ${found.views === "none" ? "without views" : several}${found.corrected ? `, ${found.corrected} corrected` : ""}; ${found.skipped.length} skipped`;
    old.hidden = !found.outdated;
    panels.hidden = found.panels.length < 2;
    panels.replaceChildren(...found.panels.map((name, k) => choice(name, k === at.panel, () => { Object.assign(at, { panel: k, view: -1, page: 0 }); all(); })));
    const most = Math.max(...found.counts, 1);
    const every = choice(`all ${found.pictures.toLocaleString("en")}`, at.view < 0, () => { Object.assign(at, { view: -1, page: 0 }); all(); });
    bars.replaceChildren(every, ...found.labels.map((label, k) => {
      const bar = make("meter", { min: 0, max: most, value: found.counts[k] });
      const button = choice("", at.view === k, () => { Object.assign(at, { view: k, page: 0 }); all(); });
      button.append(make("span", label), bar, make("span", String(found.counts[k])));
      if (found.correctable) takesPictures(button, k);
      return button;
    }));
    views.hidden = found.labels.length < 2;
    const shares = found.views !== "predicted" ? "" : "The least sure first. The percentage is how probable the predictor finds the view that a picture has; views are drawn by these probabilities, so that some are improbable.";
    how.textContent = `${shares} ${found.correctable ? "Drag one to its view above, or choose it, to correct it." : ""}`;
    table.hidden = !found.correctable;
    skipped.hidden = !found.skipped.length;
    skipped.replaceChildren(make("h2", "Skipped"), make("table", ...found.skipped.map(([name, why]) => make("tr", make("td", name), make("td", why)))));
  }
  function choice(name, on, chosen) {
    const button = make("button", { type: "button", "aria-pressed": String(on) }, name);
    button.onclick = chosen;
    return button;
  }
  async function pictures() {
    const part = await ask("/api/pictures", { run: query.run, panel: at.panel, view: at.view, page: at.page });
    cells.replaceChildren(...part.pictures.map((one) => {
      const label = views.hidden ? one.name : found.labels[one.view], sure = one.corrected ? "corrected" : one.sure === null ? "" : `${Math.round(100 * one.sure)} %`;
      const cell = make("button", { type: "button", title: one.name, disabled: !found.correctable }, make("img", { src: one.picture, alt: one.name }), make("span.small", `${label} ${sure}`));
      if (!one.corrected && one.sure !== null && one.sure < 0.5) cell.classList.add("unsure");
      cell.onclick = () => edit(one);
      cell.draggable = found.correctable;
      cell.ondragstart = (event) => { event.dataTransfer.setData("text/plain", one.name); event.dataTransfer.effectAllowed = "move"; };
      return cell;
    }));
    const count = Math.ceil(part.total / part.page);
    pages.replaceChildren(...(count > 1 ? [
      Object.assign(choice("←", false, () => { at.page -= 1; all(); }), { disabled: at.page < 1, ariaLabel: "page before" }),
      make("span", `page ${at.page + 1} of ${count}`),
      Object.assign(choice("→", false, () => { at.page += 1; all(); }), { disabled: at.page >= count - 1, ariaLabel: "next page" }),
    ] : []));
  }
  function takesPictures(button, view) {
    button.ondragover = (event) => { event.preventDefault(); button.classList.add("over"); };
    button.ondragleave = () => button.classList.remove("over");
    button.ondrop = (event) => {
      event.preventDefault();
      button.classList.remove("over");
      correct(event.dataTransfer.getData("text/plain"), view).catch(say);
    };
  }
  async function correct(name, view) {
    const body = JSON.stringify({ run: query.run, panel: at.panel, name, view });
    await ask("/api/view", {}, { method: "POST", body, headers: { "Content-Type": "application/json" } });
    await refresh();
    saved.textContent = "Saved. Download views.csv, which holds the views of all pictures, put it beside them and train with --views known.";
    saved.hidden = false;
  }
  function edit(one) {
    const select = make("select", { "aria-label": "its view" }, ...found.labels.map((label, k) => make("option", { value: k }, label)));
    select.value = one.view;
    const save = make("button", { type: "button" }, "Save its view");
    save.onclick = () => correct(one.name, Number(select.value)).catch(say);
    correction.replaceChildren(make("h2", one.name), make("div.bar", make("img.pixels.one", { src: one.picture, alt: one.name }), select, save));
    correction.hidden = false;
    correction.scrollIntoView({ block: "nearest" });
    select.focus();
  }
  async function refresh() { await collection(); await pictures(); say(null); }
  function all() {
    correction.hidden = true; // it is of a picture that was shown before
    keep({ panel: at.panel || "", view: at.view < 0 ? "" : at.view, page: at.page || "" });
    refresh().catch(say);
  }
  all();
}
