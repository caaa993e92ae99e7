// A picture of a lab that tells Python where it is clicked, drawn on and pointed at. Places are in
// pixels of the picture, whatever its size on the page.
function render({ model, el }) {
  const image = document.createElement("img");
  image.draggable = false;
  el.classList.add("uavdh-picture");
  el.append(image);
  const listens = (kind) => model.get("listens").includes(kind);
  let moved = null; // the last place that Python does not know of

  let pixels = [0, 0]; // the picture's; while the next one loads, it has none of its own
  image.addEventListener("load", () => {
    pixels = [image.naturalWidth, image.naturalHeight];
  });

  function show() {
    URL.revokeObjectURL(image.src);
    image.src = URL.createObjectURL(new Blob([model.get("value")], { type: "image/png" }));
  }

  function tell(kind, event) {
    const { left, top, width, height } = image.getBoundingClientRect();
    const [across, down] = pixels;
    if (!across || !width || !height) return;
    const x = ((event.clientX - left) / width) * across;
    const y = ((event.clientY - top) / height) * down;
    model.send({ kind, x, y, pressed: (event.buttons & 1) === 1 });
  }

  image.addEventListener("click", (event) => listens("click") && tell("click", event));
  image.addEventListener("pointerdown", (event) => {
    if (!listens("draw") || event.button !== 0) return;
    event.preventDefault();
    image.setPointerCapture(event.pointerId);
    moved = null;
    tell("down", event);
  });
  image.addEventListener("pointermove", (event) => {
    if (!listens("draw")) return;
    if (moved === null) {
      requestAnimationFrame(() => {
        if (moved !== null) tell("move", moved);
        moved = null;
      });
    }
    moved = event;
  });
  image.addEventListener("pointerup", (event) => {
    if (!listens("draw") || event.button !== 0) return;
    if (moved !== null) tell("move", moved);
    moved = null;
    tell("up", event);
  });

  // Keys count while the mouse is over the picture, unless one writes somewhere.
  function pressed(event) {
    const writing = event.target.matches?.("input, textarea, select");
    if (writing || event.ctrlKey || event.metaKey || event.altKey) return;
    if (listens("key") && image.matches(":hover")) model.send({ kind: "key", key: event.key });
  }
  document.addEventListener("keydown", pressed);

  function resize() {
    const [width, height] = model.get("size");
    el.style.setProperty("--width", width);
    el.style.setProperty("--ratio", width / height);
  }

  // The colours of the page around, so that no white box stands on a dark page.
  const dark = matchMedia("(prefers-color-scheme: dark)");
  function look() {
    if (!el.isConnected) return;
    const page = { paper: hex(paperBehind(el)), ink: hex(getComputedStyle(el).color) };
    const known = model.get("page");
    if (page.paper === known.paper && page.ink === known.ink) return;
    model.set("page", page);
    model.save_changes();
  }
  const lookSoon = () => setTimeout(look, 100); // once the page has its new colours
  const themes = new MutationObserver(lookSoon); // JupyterLab's are named at the body
  themes.observe(document.body, { attributeFilter: ["data-jp-theme-name", "data-jp-theme-light"] });
  dark.addEventListener("change", lookSoon);
  document.addEventListener("fullscreenchange", lookSoon);
  const placed = new ResizeObserver(look); // it is on the page now
  placed.observe(el);

  const describe = () => {
    image.alt = model.get("alt");
  };
  const mark = () => image.classList.toggle("drawn-on", listens("draw"));
  const changes = {
    "change:value": show,
    "change:alt": describe,
    "change:listens": mark,
    "change:size": resize,
  };
  for (const [name, change] of Object.entries(changes)) {
    model.on(name, change);
    change();
  }
  return () => {
    for (const [name, change] of Object.entries(changes)) model.off(name, change);
    document.removeEventListener("keydown", pressed);
    document.removeEventListener("fullscreenchange", lookSoon);
    dark.removeEventListener("change", lookSoon);
    themes.disconnect();
    placed.disconnect();
    URL.revokeObjectURL(image.src);
  };
}

// The colour behind an element: its own, or the first one around it.
function paperBehind(element) {
  for (let each = element; each; each = each.parentElement) {
    const colour = getComputedStyle(each).backgroundColor;
    if (!/, 0\)$|^transparent$/.test(colour)) return colour;
  }
  return "rgb(255, 255, 255)";
}

// A colour as #rrggbb.
function hex(colour) {
  const numbers = colour.match(/[\d.]+/g).slice(0, 3);
  return `#${numbers.map((each) => Math.round(each).toString(16).padStart(2, "0")).join("")}`;
}

export default { render };
