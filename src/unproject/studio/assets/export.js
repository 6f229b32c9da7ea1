// Export: whatever is on screen as a file.
import { answerTo, make, say } from "/assets/app.js";

const SAYS = {
  glb: "Mesh (.glb)", obj: "Mesh (.obj)", ply: "Mesh (.ply)", vox: "Voxels (.vox)", gif: "Turntable (.gif)",
  npz: "Arrays (.npz)", png: "Picture (.png)", maps: "Maps (.zip of PNG)", mtlx: "MaterialX (.zip)", gltf: "Plane with it (.glb)",
};
const ORDER = Object.keys(SAYS);

// Stores what a blob holds under a name.
export function store(blob, name) {
  const url = URL.createObjectURL(blob);
  make("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

// Fetches a file and stores it; what goes wrong is said on the page, not stored.
export async function download(path, query) {
  const answer = await answerTo(path, query, { signal: null }); // it goes on when the panel is left
  const told = answer.headers.get("Content-Disposition") || "";
  const name = /filename\*=UTF-8''(.+)$/.exec(told) || /filename="([^"]+)"/.exec(told);
  store(await answer.blob(), name ? decodeURIComponent(name[1]) : "file");
}

export function downloadButton(says, path, query) {
  const button = make("button", { type: "button" }, says);
  button.onclick = () => waiting(button, () => download(path, query()));
  return button;
}

async function waiting(button, work) {
  button.disabled = true;
  try { await work(); say(null); } catch (error) { say(error); }
  button.disabled = false;
}

// A choice of formats and a button; asked() names what is on screen.
export function exportBar(formats, first, path, asked) {
  const known = [...formats].sort((a, b) => (ORDER.indexOf(a) + 99) % 99 - (ORDER.indexOf(b) + 99) % 99);
  const select = make("select", { "aria-label": "format" }, ...known.map((to) => make("option", { value: to }, SAYS[to] || to)));
  select.value = known.includes(first) ? first : known[0];
  const button = make("button.main", { type: "button", title: "key E" }, "Download");
  button.onclick = () => waiting(button, () => download(path, { ...asked(), to: select.value }));
  button.dataset.key = "e";
  return make("div.bar.export", select, button);
}

// What a canvas or an image shows, as a picture.
export function pictureButton(shown, name) {
  const button = make("button", { type: "button" }, "This view as a picture");
  button.onclick = () => {
    const seen = shown(), file = name().replace(/[^\p{L}\p{N}_.-]+/gu, "-").replace(/^[.-]+/, "");
    if (!seen) return;
    if (seen.tagName === "IMG") make("a", { href: seen.src, download: `${file}.${/^data:image\/(\w+)/.exec(seen.src)[1]}` }).click();
    else seen.toBlob((blob) => store(blob, `${file}.png`));
  };
  return button;
}
