"use strict";
// Starts the viewer and the slider of the page, and the buttons that copy commands.

const held = document.getElementById("viewer-data");
if (held) {
  const data = JSON.parse(held.textContent);
  const [canvas, buttons, note] = ["viewer", "chooser", "viewer-note"].map((id) => document.getElementById(id));
  try {
    (data.kind === "shapes" ? showShapes : showMaterials)(data, canvas, buttons, note);
  } catch (error) {
    note.textContent = `This browser cannot draw it (${error.message}).`;
  }
}

const slider = document.getElementById("time");
if (slider) {
  const frames = [...document.querySelectorAll(".frame")];
  const label = document.getElementById("time-label");
  slider.max = frames.length - 1;
  slider.value = frames.length - 1;
  slider.addEventListener("input", () => {
    frames.forEach((frame, k) => { frame.hidden = k !== Number(slider.value); });
    const step = frames[Number(slider.value)].dataset.step;
    label.textContent = slider.ariaValueText = `step ${Number(step).toLocaleString("en")}`;
  });
}

for (const button of document.querySelectorAll("button.copy")) {
  if (!navigator.clipboard) { button.hidden = true; continue; } // such as in a page from disk, in some browsers
  button.addEventListener("click", async () => {
    await navigator.clipboard.writeText(button.previousElementSibling.textContent);
    button.textContent = "copied";
    setTimeout(() => { button.textContent = "copy"; }, 1500);
  });
}
