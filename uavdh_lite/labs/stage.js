// The stage: one page with the map, the controls and the panel of a tool. `paint` draws what Python
// sent, the scene; whatever is done is told to Python, which answers with the next scene.

const MORE = "Cells, numbers and files";
const LINK = "stage=";

function page(tools) {
  const tab = (tool) => `<button type="button" role="tab" id="tab-${tool}" data-tool="${tool}"
    aria-controls="panel">${TOOLS[tool].title}</button>`;
  return `<div class="top">
      <div role="tablist" aria-label="tools">${tools.map(tab).join("")}</div>${CONTROLS}
      <div class="actions">
        <select data-set="city" aria-label="city"></select>
        ${button("New", { kind: "new" }, 'title="a new random mission"')}
        ${button("↶", { kind: "undo", by: -1 }, 'class="undo" aria-label="undo"')}
        ${button("↷", { kind: "undo", by: 1 }, 'class="redo" aria-label="redo"')}
        <button type="button" class="copy">Link</button>
        <button type="button" class="more" aria-expanded="false" title="${MORE}">More</button>
        <button type="button" class="full" aria-label="full screen"><svg viewBox="0 0 16 16" width="16"
          ><path d="M1 6V1h5M10 1h5v5M15 10v5h-5M6 15H1v-5"/></svg></button>
      </div></div>
    <div class="notices"><div class="refusal" role="alert"></div></div>
    <div class="main"><div class="stages"></div>
      <div class="tool" id="panel" role="tabpanel" tabindex="-1"></div></div>
    <div class="caption" role="status" hidden></div>
    <div class="drawer" hidden></div>`;
}

function render({ model, el }) {
  el.classList.add("uavdh-player", "uavdh-stage");
  el.setAttribute("data-lm-suppress-shortcuts", "true");
  const find = (selector) => el.querySelector(selector);
  let scene = model.get("scene");
  let [version, drawnTool, update] = [null, null, () => []];
  let waiting = false; // for an answer of Python
  let next = null; // what is asked when it has come
  let story = null; // the captions that are still to come
  let hovered = null; // the cell under the pointer
  let [drag, remembering] = [null, null];
  let [answered, quiet, refusing] = [0, false, null]; // quiet: what was asked is no action of the reader
  el.innerHTML = page(scene.tools);
  if (scene.tools.length === 1) find("[role=tablist]").hidden = true;
  new ResizeObserver(() => {
    el.style.setProperty("--wide", `${el.clientWidth}px`);
    el.classList.toggle("narrow", el.clientWidth < 1000);
  }).observe(el);
  find(".copy").hidden = !OWN;

  const ask = (told) => {
    if (told.show !== undefined) return clock.show(told.show);
    if (told.kind === "tool") clock.show(clock.now.time); // pauses, so that the step is kept
    [waiting, quiet] = [true, ["show", "values", "shadow"].includes(told.kind)];
    model.send(told);
  };
  // Stays until the answer to what was done; a refusal 8 seconds at most
  const refuse = (text, busy = false) => {
    clearTimeout(refusing);
    find(".refusal").textContent = text;
    find(".refusal").classList.toggle("busy", busy);
    if (!busy) refusing = setTimeout(() => (find(".refusal").textContent = ""), 8000);
  };
  const stage = {
    find,
    askWhenFree(told) {
      if (waiting) next = told;
      else ask(told);
    },
    fill(selector, html) {
      const place = find(selector);
      if (place && place.written !== html) [place.written, place.innerHTML] = [html, html];
    },
    // Shifts the map so that a place is in the middle of all that a network sees; null: as it is
    centre(place) {
      const svg = find(".map svg");
      const size = scene.film.city.length;
      svg.usual ??= svg.getAttribute("viewBox");
      const box = place && `${place[1] - size + 0.5} ${place[0] - size + 0.5}`;
      const view = place ? `${box} ${2 * size - 1} ${2 * size - 1}` : svg.usual;
      svg.setAttribute("viewBox", view);
    },
  };
  const clock = playback(el, (time, playing) => {
    const texts = update(time, playing);
    TOOLS[scene.state.tool].moment?.(stage, scene, time);
    tellStory(time, playing);
    if (!playing && scene.state.tool !== "fly") keepStep(time);
    return texts;
  });

  // The address and the saved file know the step, too
  let keeping = null;
  window.addEventListener("beforeunload", () => {
    clearTimeout(keeping); // the session ends first
    if (remembering) remember();
  });
  function keepStep(time) {
    clearTimeout(keeping);
    const step = time === clock.now.last ? -1 : Math.floor(time);
    if (step === scene.state.step || scene.fresh) return;
    keeping = setTimeout(() => stage.askWhenFree({ kind: "show", step }), 400);
  }

  function paint() {
    const { state, film, panel } = scene;
    const tool = TOOLS[state.tool];
    for (const tab of el.querySelectorAll("[data-tool]")) {
      const on = tab.dataset.tool === state.tool;
      tab.setAttribute("aria-selected", on);
      tab.tabIndex = on ? 0 : -1;
    }
    find(".main").dataset.shows = state.tool;
    find(".main").classList.remove("layered");
    find("#panel").setAttribute("aria-labelledby", `tab-${state.tool}`);
    const changed = version !== scene.version || drawnTool !== state.tool;
    const held = heldFocus();
    if (changed) drawMaps(film, state.tool);
    stage.fill(".tool", tool.html(scene));
    film.flights.forEach((_, k) => {
      const map = el.querySelectorAll(".map svg")[k];
      if (!map) return;
      map.querySelector(".under").innerHTML = tool.under?.(scene, k) ?? "";
      map.querySelector(".over").innerHTML = tool.over?.(scene, k) ?? "";
    });
    const cities = state.cities.map((each) => [each, each]);
    find("[data-set=city]").innerHTML = options(cities, state.city);
    find(".undo").disabled = !state.undo;
    find(".redo").disabled = !state.redo;
    paintDrawer();
    clearTimeout(remembering); // a new address costs more than a new picture: it comes after it
    if (!scene.fresh && OWN) remembering = setTimeout(remember);
    const fly = state.tool === "fly"; // shows the last step, and flies it; the others know their step
    const last = fly ? film.flights[0].path.length - 1 : lastStep(film);
    if (changed) {
      const flies = fly && drawnTool === "fly" && last > 0;
      const now = clock.now.time === clock.now.last ? -1 : clock.now.time;
      const known = [null, "fly", state.tool].includes(drawnTool) ? state.step : now;
      clock.load(last, flies ? last - 1 : fly || known < 0 ? last : known, flies);
    } else clock.show(clock.now.time, clock.now.playing);
    [version, drawnTool] = [scene.version, state.tool];
    if (hovered && !film.city[hovered[0]]?.[hovered[1]]) hovered = null;
    tool.point?.(stage, scene, hovered);
    held();
  }

  function drawMaps(film, tool) {
    const shown = tool === "compare" ? film : { ...film, flights: film.flights.slice(0, 1) };
    find(".stages").innerHTML = flightPanels(shown);
    update = showing(find(".flights"), shown);
    for (const map of el.querySelectorAll(".map svg")) map.setAttribute("role", "group");
    for (const device of el.querySelectorAll(".map g[data-device]")) {
      const k = Number(device.dataset.device);
      const [row, col] = film.devices[k].cell;
      device.setAttribute("tabindex", "0");
      device.setAttribute("role", "button");
      device.setAttribute("aria-label", `device ${k}, row ${row}, column ${col}; arrows move it`);
    }
  }

  // A function that gives the focus back to what has taken its place
  function heldFocus() {
    const focused = el.contains(document.activeElement) ? document.activeElement : null;
    const { device, ask: asks, set, sign, field } = focused?.dataset ?? {};
    const named = { device, ask: asks, set, sign, field };
    const [name, value] = Object.entries(named).find(([, each]) => each !== undefined) ?? [];
    return () => {
      if (!name || el.contains(document.activeElement)) return;
      const where = focused.closest("svg") ? "svg " : device ? ".side " : "";
      find(`${where}[data-${name}="${CSS.escape(value)}"]`)?.focus({ preventScroll: true });
    };
  }

  function paintDrawer() {
    const { state } = scene;
    const full = state.devices.length >= state.most;
    const adding = el.classList.contains("adding") && !full;
    const hint = full ? `at most ${state.most} devices here` : adding ? "Press a free cell on the map." : "";
    const field = (name, label, value) =>
      `<label>${label} <input type="number" data-field="${name}" value="${value}" step="any">
      </label>`;
    const row = ({ cell, data }, k) => `<tr><th>device ${k}</th>
      <td>${field(`row ${k}`, "row", cell[0])}</td><td>${field(`col ${k}`, "column", cell[1])}</td>
      <td>${field(`data ${k}`, "data", data)}</td>
      <td>${button("remove", { kind: "remove", device: k })}</td></tr>`;
    stage.fill(
      ".drawer",
      `<h2>${MORE}</h2><table>${state.devices.map(row).join("")}</table>
      <div class="row">${field("time", "flying time", state.flying_time)}
        ${field("row -1", "start: row", state.start[0])}
        ${field("col -1", "column", state.start[1])}</div>
      <div class="row"><button type="button" data-set="place" aria-pressed="${adding}"
        ${full ? "disabled" : ""}>Add a device</button><span role="status">${hint}</span>
        ${button("Save", { kind: "save", what: "stage" })}
        ${button("Save the mission alone", { kind: "save", what: "mission" })}
        <label class="file">Open <input type="file" accept=".json,.png"></label></div>
      <p>Save keeps city, mission, rivals and step in a file; Open reads it, a mission, or a city's
      PNG. On the map, drag devices and the start; or press Tab and move them with the arrow
      keys; Delete removes one.</p>`,
    );
  }

  function remember() {
    const address = `#${LINK}${scene.state.link}`;
    if (location.hash !== address) history.replaceState(null, "", address);
  }

  // The story: a duel plays, and captions say what to look at

  function beginStory() {
    if (!scene.fresh || !scene.panel.story) return;
    ({ story } = scene.panel);
    el.classList.add("telling");
    clock.show(0, true);
  }

  function tellStory(time, playing) {
    if (!story) return;
    const [, text] = story.filter(([from]) => from <= time).at(-1);
    const caption = find(".caption");
    const end = time >= clock.now.last;
    caption.hidden = false;
    if (caption.dataset.text !== text) {
      caption.dataset.text = text;
      const more = end ? "Your turn" : "Skip the story";
      const held = !caption.innerHTML || caption.contains(document.activeElement);
      caption.innerHTML = `<p>${escaped(text)}</p><p><small>Orange ring: where they part.</small></p>
        <button type="button" class="skip">${more}</button>`;
      if (held) find(".skip").focus(); // so that Enter goes on
      if (end || !playing) return;
      const go = () => story && caption.dataset.text === text && clock.show(clock.now.time, true);
      setTimeout(() => clock.show(time, false));
      setTimeout(go, Math.max(6500, 70 * text.length)); // time to read it
    }
  }

  function endStory() {
    [story, find(".caption").hidden] = [null, true];
    el.classList.remove("telling");
  }

  // What is done

  const maps = () => [...el.querySelectorAll(".map svg")]; // each answer may draw them anew
  const cellAt = (event) => {
    const svg = event.target.closest?.(".map")?.querySelector("svg") ?? (drag && maps()[drag.map]);
    if (!svg) return null;
    const pointer = new DOMPoint(event.clientX, event.clientY);
    const { x, y } = pointer.matrixTransform(svg.getScreenCTM().inverse());
    const [row, col] = [Math.round(y), Math.round(x)];
    return scene.film.city[row]?.[col] === undefined ? null : [row, col];
  };
  const thingAt = (cell) => {
    if (!cell) return null;
    const here = ({ cell: [row, col] }) => row === cell[0] && col === cell[1];
    const device = scene.state.devices.findIndex(here);
    return device >= 0 ? device : here({ cell: scene.state.start }) ? -1 : null;
  };
  const main = find(".main");

  main.addEventListener("pointerdown", (event) => {
    const cell = event.target.closest(".map") && cellAt(event);
    if (!cell || event.button) return;
    const adding = el.classList.contains("adding");
    const thing = thingAt(cell);
    const painting = scene.state.tool === "paint" && thing === null;
    TOOLS[scene.state.tool].point?.(stage, scene, (hovered = cell)); // a finger does not hover
    if (adding) {
      el.classList.remove("adding");
      return ask({ kind: "add", cell });
    }
    if (!painting && (thing === null || scene.state.tool === "train")) return;
    if (scene.state.tool === "channel" && thing >= 0) ask({ kind: "look", device: thing });
    event.preventDefault();
    main.setPointerCapture(event.pointerId);
    const map = maps().indexOf(event.target.closest(".map").querySelector("svg"));
    drag = { thing, at: cell, map };
    if (painting) {
      brush.cells = [];
      stroke(cell);
    }
  });
  main.addEventListener("pointermove", (event) => {
    const cell = cellAt(event);
    if (!drag) {
      if (event.target.closest?.(".map")) {
        hovered = cell;
        TOOLS[scene.state.tool].point?.(stage, scene, cell);
      }
      return;
    }
    if (!cell || String(cell) === String(drag.at)) return;
    const before = drag.at;
    hovered = drag.at = cell;
    if (brush.cells) strokeTo(cell, before);
    else stage.askWhenFree({ kind: "move", device: drag.thing, cell });
  });
  main.addEventListener("pointerleave", ({ pointerType }) => {
    if (!drag && pointerType !== "touch") TOOLS[scene.state.tool].point?.(stage, scene, (hovered = null));
  });
  const release = () => {
    if (brush.cells) ask({ kind: "paint", cells: brush.cells, sign: brush.sign });
    [drag, brush.cells] = [null, null];
  };
  main.addEventListener("pointerup", release);
  main.addEventListener("pointercancel", release);

  // All cells on the way, however fast the pointer is
  function strokeTo(cell, before) {
    const ways = cell.map((each, axis) => each - before[axis]);
    const count = Math.max(...ways.map(Math.abs));
    for (let k = 1; k <= count; k += 1) {
      stroke(before.map((each, axis) => Math.round(each + (k / count) * ways[axis])));
    }
  }

  // Paints a cell in the browser until the stroke is over
  function stroke(cell) {
    if (brush.cells.some((each) => String(each) === String(cell))) return;
    brush.cells.push(cell);
    const squares = brush.cells.map(([row, col]) => `M${col - 0.5} ${row - 0.5}${SQUARE}`).join("");
    const fresh = find(".fresh");
    fresh.setAttribute("class", `fresh kind-${brush.sign === "." ? "free" : brush.sign}`);
    fresh.setAttribute("d", squares);
  }

  // Where the pointer presses curves beside their points, the nearest point is meant
  const pressed = ({ target, detail, clientX, clientY }) => {
    if (!detail || target.matches(".dot")) return target;
    const dots = [...(target.closest(".curves")?.querySelectorAll(".dot") ?? [])];
    const far = (dot) => {
      const { x, y, width } = dot.getBoundingClientRect();
      return Math.hypot(x + width / 2 - clientX, y + width / 2 - clientY);
    };
    return dots.sort((one, other) => far(one) - far(other))[0] ?? target;
  };
  el.addEventListener("click", (event) => {
    const target = pressed(event).closest("button, [data-ask], .term");
    if (!target) return;
    const { ask: asked, tool, sign, busy } = target.dataset;
    if (!target.matches(".skip, .play, .forward, .back")) endStory();
    if (asked) {
      if (busy) refuse(busy, true);
      ask(JSON.parse(asked));
    } else if (tool) {
      ask({ kind: "tool", tool });
      if (tool === "fly") find("#panel").focus({ preventScroll: true }); // its arrow keys steer
    } else if (sign) {
      brush.sign = sign;
      paint();
    } else if (target.matches(".begin")) {
      ask({ kind: "train", settings: chosen.train.filter((name) => name) });
    } else if (target.matches(".skip")) {
      const end = clock.now.time >= clock.now.last;
      endStory();
      if (!end) clock.show(clock.now.last);
    } else if (target.matches(".copy")) copyLink(target);
    else if (target.matches(".more")) {
      const drawer = find(".drawer");
      drawer.hidden = !drawer.hidden;
      (drawer.hidden ? find(".main") : drawer).before(find(".notices")); // where the eye is
      target.setAttribute("aria-expanded", !drawer.hidden);
      if (!drawer.hidden) drawer.scrollIntoView({ block: "nearest" });
    } else if (target.matches(".full")) {
      if (document.fullscreenElement) document.exitFullscreen();
      else el.requestFullscreen();
    } else if (target.dataset.set === "place") {
      el.classList.toggle("adding");
      paint();
    }
    // Keys steer after a press, too, unless it asks for a place or a number
    const steers = scene.state.tool === "fly" && event.detail && !target.closest(".drawer, .term");
    if (steers) find("#panel").focus({ preventScroll: true });
  });

  async function copyLink(target) {
    const link = `${location.href.split("#")[0]}#${LINK}${scene.state.link}`;
    await navigator.clipboard?.writeText(link).catch(() => {});
    remember();
    target.textContent = "Copied";
    setTimeout(() => (target.textContent = "Link"), 1500);
  }

  el.addEventListener("change", async ({ target }) => {
    const { set, field } = target.dataset;
    const { value } = target;
    if (scene.state.tool === "fly") target.blur(); // so that keys steer again
    if (set === "city") ask({ kind: "city", name: value });
    else if (set?.startsWith("policy-")) ask({ kind: "policy", which: Number(set.at(-1)), name: value });
    else if (set === "layer") stage_layer.name = value;
    else if (set === "centred") stage_layer.centred = target.checked;
    else if (set === "blue") chosen.train[0] = value;
    else if (set === "orange") chosen.train[1] = value;
    else if (set === "metric") chosen.metric = value;
    if (["layer", "centred", "blue", "orange", "metric"].includes(set)) paint();
    if (field) changeField(field, target.valueAsNumber);
    if (target.files?.length) openFile(target.files[0]);
  });

  function changeField(field, value) {
    const [name, place] = field.split(" ");
    const device = Number(place);
    if (name === "data") ask({ kind: "data", device, value });
    else if (!place) ask({ kind: name, value });
    else {
      const { start, devices } = scene.state;
      const cell = [...(device < 0 ? start : devices[device].cell)];
      cell[name === "row" ? 0 : 1] = value;
      ask({ kind: "move", device, cell });
    }
    find(".drawer").written = null; // so that a refused number is put back
  }

  async function openFile(file) {
    if (file.size > 1_000_000) return refuse("Not done: too large.");
    if (!file.name.endsWith(".png")) return ask({ kind: "open", text: await file.text() });
    const bytes = new Uint8Array(await file.arrayBuffer());
    ask({ kind: "open", picture: btoa(String.fromCharCode(...bytes)) });
  }

  // Before the playback hears of it: keys that steer, or move what has the focus
  const onKey = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.matches("input, select")) return;
    const tab = event.target.closest("[role=tab]");
    const side = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const device = event.target.closest("g[data-device]")?.dataset.device;
    const steer = TOOLS[scene.state.tool].keys?.[event.key];
    const [down, right] = WAYS[ARROWS[event.key]] ?? [];
    let told = null;
    if (event.key === "Escape") {
      el.classList.remove("adding");
      paint();
      endStory();
    } else if (tab && side) {
      const { tools } = scene;
      const to = tools[(tools.indexOf(tab.dataset.tool) + side + tools.length) % tools.length];
      find(`#tab-${to}`).focus();
      told = { kind: "tool", tool: to };
    } else if (device && down !== undefined) {
      const [row, col] = scene.state.devices[device].cell;
      told = { kind: "move", device: Number(device), cell: [row + down, col + right] };
    } else if (device && ["Delete", "Backspace"].includes(event.key)) {
      told = { kind: "remove", device: Number(device) };
    } else if (event.target.matches("[role=button]") && event.key === "Enter") {
      event.target.dispatchEvent(new MouseEvent("click", { bubbles: true }));
    } else if (steer && !(event.key === " " && event.target.matches("button:not([role=tab])"))) {
      told = { kind: "fly", action: steer };
    }
    if (!told) return;
    event.preventDefault();
    event.stopPropagation();
    endStory();
    ask(told);
  };
  const listens = OWN ? document : el; // on a page of our own, whatever has the focus
  listens.addEventListener("keydown", onKey, true);

  model.on("change:scene", () => {
    scene = model.get("scene");
    waiting = false;
    const fresh = scene.answered !== answered && (!quiet || scene.refused);
    if (fresh) refuse(scene.refused && `Not done: ${scene.refused}.`);
    answered = scene.answered;
    if (drag && brush.cells) return;
    paint();
    const told = next;
    next = null;
    if (told) stage.askWhenFree(told);
  });
  model.on("msg:custom", ({ name, address }) => {
    Object.assign(document.createElement("a"), { href: address, download: name }).click();
  });

  const linked = () => OWN && location.hash.split(LINK)[1];
  const another = () => linked() && linked() !== scene.state.link;
  const openLink = () => another() && ask({ kind: "open", link: linked() });
  window.addEventListener("hashchange", openLink);
  if (another()) find(".stages").textContent = "Opening your mission …";
  else paint();
  openLink();
  if (OWN && !linked()) beginStory();
  return () => {
    window.removeEventListener("hashchange", openLink);
    listens.removeEventListener("keydown", onKey, true);
  };
}

export default { render };
