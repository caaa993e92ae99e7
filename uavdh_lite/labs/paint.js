// Painting a city, and the shadow that a device would have.

import { KINDS, SQUARE, cells, tiles } from "../player.js";
import { button, term } from "./html.js";

export const brush = { sign: "B", cells: null }; // cells: those of the stroke that is being painted

export const PAINT = {
  title: "Paint",
  still: () => true,
  cursor: "arrow keys move the cell; space paints it",
  html() {
    const swatch = ([sign, { name }]) => `<button type="button" class="swatch" data-sign="${sign}"
      aria-pressed="${sign === brush.sign}"><svg viewBox="-.6 -.6 1.2 1.2" aria-hidden="true"><path class="paper"
      d="M-.5 -.5${SQUARE}"/>${sign === "." ? "" : cells([sign], sign)}</svg>${name.split(":")[0]}</button>`;
    const all = [[".", { name: "open ground" }], ...Object.entries(KINDS)];
    return `<h2>Draw a city</h2><div class="swatches">${all.map(swatch).join("")}</div>
      <p>Violet: what a device at the pointer could not see. Low buildings hide things, too.</p>
      <div class="row">${button("Save as PNG", { kind: "save", what: "png" })}</div>`;
  },
  over: () => '<path class="shadow live"/><g class="fresh"></g>',
  point(stage, { panel }, cell) {
    if (brush.cells) return;
    if (!cell) return stage.find(".live")?.setAttribute("d", "");
    const { shadow: known } = panel;
    if (known && String(known.cell) === String(cell)) {
      stage.find(".live")?.setAttribute("d", tiles(known.rows, "#", SQUARE));
    } else stage.askWhenFree({ kind: "shadow", cell });
  },
};
