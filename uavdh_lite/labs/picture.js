// A picture of a lab that tells Python where it is clicked, drawn on and pointed at. Places are in
// pixels of the picture, whatever its size on the page.
function render({ model, el }) {
  const image = document.createElement("img");
  image.draggable = false;
  el.classList.add("uavdh-picture");
  el.append(image);
  const listens = (kind) => model.get("listens").includes(kind);
  let moved = null; // the last place that Python does not know of

  function show() {
    URL.revokeObjectURL(image.src);
    image.src = URL.createObjectURL(new Blob([model.get("value")], { type: "image/png" }));
  }

  function tell(kind, event) {
    const { left, top, width, height } = image.getBoundingClientRect();
    const x = ((event.clientX - left) / width) * image.naturalWidth;
    const y = ((event.clientY - top) / height) * image.naturalHeight;
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
    URL.revokeObjectURL(image.src);
  };
}

export default { render };
