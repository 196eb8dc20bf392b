// The live view: one module for the page of `wrt view` and for the widget of notebooks.
// A link has send(message), and calls link.receive(message, bytes) with what comes; see wrt/view/viewer.py.

const LAYERS = {
  "": "Picture", noise: "Noise", albedo: "Albedo", normal: "Normal", geometric_normal: "Geometric normal",
  depth: "Depth", position: "Position", alpha: "Coverage", object: "Objects", material: "Materials",
};
const INTEGRATORS = {
  "": "Scene's own", path: "Path", volpath: "Path with media", direct: "Direct light", whitted: "Whitted",
  ao: "Ambient occlusion",
};
const TONES = { soft: "Soft", none: "None", neutral: "Khronos neutral", agx: "AgX", aces: "ACES" };
const KEYS = [
  ["Drag, arrows", "orbit"], ["Right drag, Shift + arrows", "pan"], ["Wheel, + and −", "zoom"],
  ["Shift + click", "focus there"], ["Double click", "fly to a shape"], ["R", "scene's camera"],
  ["F", "see everything"], ["H", "hide this panel"],
];

// Vectors of three numbers.
const add = (a, b) => a.map((x, i) => x + b[i]);
const sub = (a, b) => a.map((x, i) => x - b[i]);
const mul = (a, k) => a.map((x) => x * k);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => mul(a, 1 / (length(a) || 1));

function rotated(v, axis, angle) { // Rodrigues' formula
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(mul(v, c), mul(cross(axis, v), s)), mul(axis, dot(axis, v) * (1 - c)));
}

export function orbited(camera, dx, dy) {
  const up = unit(camera.up), away = sub(camera.origin, camera.target);
  let turned = rotated(away, up, -dx);
  const right = unit(cross(up, turned));
  const elevation = Math.asin(Math.max(-1, Math.min(1, dot(unit(turned), up))));
  const limit = Math.PI / 2 - 0.01; // never over the pole, where the picture would turn round
  const wanted = Math.max(-limit, Math.min(limit, elevation + dy));
  turned = rotated(turned, right, -(wanted - elevation));
  return { ...camera, origin: add(camera.target, turned) };
}

export function panned(camera, dx, dy) { // in heights of the picture
  const away = sub(camera.target, camera.origin), forward = unit(away);
  const right = unit(cross(forward, camera.up)), up = cross(right, forward);
  const height = camera.view_height ?? 2 * length(away) * Math.tan(((camera.fov_degrees ?? 40) * Math.PI) / 360);
  const step = add(mul(right, -dx * height), mul(up, dy * height));
  return { ...camera, origin: add(camera.origin, step), target: add(camera.target, step) };
}

export function zoomed(camera, factor) {
  const origin = add(camera.target, mul(sub(camera.origin, camera.target), factor));
  const zoom = { ...camera, origin };
  if (camera.view_height) zoom.view_height = camera.view_height * factor;
  return zoom;
}

export function framed(camera, bounds) { // the sphere around a box, seen from the same side
  const center = mul(add(bounds[0], bounds[1]), 0.5);
  const radius = Math.max(length(sub(bounds[1], bounds[0])) / 2, 1e-6);
  const angle = ((camera.fov_degrees ?? 40) * Math.PI) / 360;
  const distance = (1.05 * radius) / Math.sin(Math.min(angle, 1.5));
  const origin = add(center, mul(unit(sub(camera.origin, camera.target)), distance));
  const frame = { ...camera, target: center, origin };
  if (camera.view_height) frame.view_height = 2.1 * radius;
  return frame;
}

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value !== undefined && value !== null && value !== false) made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

function short(number) {
  for (const [size, sign] of [[1e9, " G"], [1e6, " M"], [1e3, " k"]])
    if (number >= size) return (number / size).toPrecision(3) + sign;
  return number.toFixed(0) + " ";
}

export function mount(root, link, { title = true } = {}) {
  const state = { camera: null, home: null, bounds: null, serial: 0, picking: false, frames: 0, header: null };
  const canvas = element("canvas", { class: "wrt-canvas", tabindex: 0, role: "img", width: 4, height: 3,
    "aria-label": "The picture. Arrow keys orbit, shift and arrows pan, plus and minus zoom." });
  const problem = element("div", { class: "wrt-error", role: "alert", hidden: true });
  const bar = element("progress", { max: 1, value: 0, "aria-label": "Samples" });
  const samples = element("span"), noise = element("span"), speed = element("span");
  const note = element("span", { class: "wrt-note", role: "status" });
  const exposed = element("output", {}, "0.0");
  const options = (values) => Object.entries(values).map(([value, text]) => element("option", { value }, text));
  const set = (values) => link.send({ type: "set", ...values });
  const layer = element("select", { name: "layer", onchange: () => set({ layer: layer.value }) }, ...options(LAYERS));
  const integrator = element("select", { name: "integrator",
    onchange: () => set({ integrator: integrator.value || null }) }, ...options(INTEGRATORS));
  const depth = element("input", { name: "max_depth", type: "number", min: 1, max: 1024, placeholder: "scene's own",
    onchange: () => depth.checkValidity() && set({ max_depth: depth.value ? Number(depth.value) : null }) });
  const exposure = element("input", { name: "exposure", type: "range", min: -6, max: 6, step: 0.1, value: 0,
    oninput: () => { exposed.value = Number(exposure.value).toFixed(1); set({ exposure: Number(exposure.value) }); },
    ondblclick: () => set({ exposure: null }) });
  const tone = element("select", { name: "tone", onchange: () => set({ tone: tone.value }) }, ...options(TONES));
  const denoise = element("input", { name: "denoise", type: "checkbox", onchange: () => set({ denoise: denoise.checked }) });
  const field = (text, input, output) => element("label", {}, element("span", {}, text, ...(output ? [output] : [])), input);
  const button = (text, action, more = {}) => element("button", { type: "button", onclick: action, ...more }, text);
  const focus = button("Pick focus", () => pick(!state.picking), { "aria-pressed": "false" });
  const heading = element("h2", {}, "wrt");
  const saves = ["PNG", "EXR"].map((kind) => button(`Save ${kind}`, () => {
    say("Saving…", 0);
    link.send({ type: "save", suffix: `.${kind.toLowerCase()}` });
  }));
  const panel = element("aside", { class: "wrt-panel", "aria-label": "Controls" },
    ...(title ? [heading] : []),
    field("Exposure, stops", exposure, exposed), field("Tone curve", tone),
    element("label", { class: "wrt-check" }, denoise, "Denoise"), field("Show", layer), field("Integrator", integrator),
    field("Path segments", depth),
    element("div", { class: "wrt-row" }, focus, button("Copy camera", () => link.send({ type: "toml" })),
      button("Scene's camera", home), button("See everything", everything), ...saves),
    element("details", { open: matchMedia("(min-width: 44rem)").matches }, element("summary", {}, "Mouse and keys"),
      element("dl", {}, ...KEYS.flatMap(([key, what]) => [element("dt", {}, key), element("dd", {}, what)]))));
  const view = element("div", { class: "wrt-view" },
    element("div", { class: "wrt-stage" },
      element("div", { class: "wrt-canvas-box" }, canvas, problem),
      element("div", { class: "wrt-status" }, bar, samples, noise, speed, note)), panel);
  root.replaceChildren(view);
  const context = canvas.getContext("2d");

  function say(text, seconds = 4) {
    note.textContent = text;
    clearTimeout(say.timer);
    if (seconds) say.timer = setTimeout(() => (note.textContent = ""), seconds * 1000);
  }

  function fail(text) {
    problem.hidden = !text;
    problem.textContent = text;
  }

  // Cameras: at most one is sent for each frame of the display, always the newest.
  let due = false;
  function look(camera) {
    if (!state.camera) return;
    state.camera = camera;
    if (due) return;
    due = true;
    requestAnimationFrame(() => {
      due = false;
      link.send({ type: "camera", camera: state.camera, serial: `${state.id}.${++state.serial}` });
    });
  }
  state.id = Math.random().toString(36).slice(2);

  function home() { if (state.home) look(structuredClone(state.home)); }
  function everything() { if (state.camera && state.bounds) fly(framed(state.camera, state.bounds)); }

  function fly(to) {
    const from = state.camera, began = performance.now(), token = (state.flight = {});
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return look(to);
    const step = () => {
      if (state.flight !== token) return;
      const t = Math.min(1, (performance.now() - began) / 450), k = t * t * (3 - 2 * t);
      const mix = (a, b) => add(mul(a, 1 - k), mul(b, k));
      look(t < 1 ? { ...to, origin: mix(from.origin, to.origin), target: mix(from.target, to.target) } : to);
      if (t < 1) requestAnimationFrame(step);
    };
    step();
  }

  function pick(on) {
    state.picking = on;
    focus.setAttribute("aria-pressed", String(on));
    canvas.classList.toggle("wrt-picking", on);
    if (on) say("Click what should be sharp.");
  }

  // Where an event is in the picture, 0 to 1 from the top left; the canvas may have margins around the picture.
  function place(event) {
    const box = canvas.getBoundingClientRect();
    const scale = Math.min(box.width / canvas.width, box.height / canvas.height);
    const x = (event.clientX - box.left - (box.width - canvas.width * scale) / 2) / (canvas.width * scale);
    const y = (event.clientY - box.top - (box.height - canvas.height * scale) / 2) / (canvas.height * scale);
    return { x, y, inside: x >= 0 && x < 1 && y >= 0 && y < 1, height: canvas.height * scale };
  }

  function ask(event, action) {
    const { x, y, inside } = place(event);
    if (inside) { say("Looking…", 0); link.send({ type: "pick", x, y, action }); }
  }

  const touches = new Map();
  let drag = null;
  canvas.addEventListener("pointerdown", (event) => {
    state.flight = null;
    canvas.focus({ preventScroll: true });
    if (state.picking || event.shiftKey) { pick(false); ask(event, "focus"); return; }
    touches.set(event.pointerId, event);
    canvas.setPointerCapture(event.pointerId);
    drag = { pan: event.button !== 0 || event.ctrlKey, height: place(event).height };
    canvas.classList.add("wrt-dragging");
    event.preventDefault();
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = touches.get(event.pointerId);
    if (!drag || !before || !state.camera) return;
    const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
    if (touches.size === 2) { // pinch: zoom and pan
      const other = [...touches].find(([id]) => id !== event.pointerId)[1];
      const span = (a) => Math.max(1, Math.hypot(a.clientX - other.clientX, a.clientY - other.clientY));
      const closer = zoomed(state.camera, span(before) / span(event));
      look(panned(closer, dx / 2 / drag.height, dy / 2 / drag.height));
    } else if (drag.pan) look(panned(state.camera, dx / drag.height, dy / drag.height));
    else look(orbited(state.camera, (dx / drag.height) * Math.PI, (dy / drag.height) * Math.PI));
    touches.set(event.pointerId, event);
  });
  const drop = (event) => {
    touches.delete(event.pointerId);
    if (!touches.size) { drag = null; canvas.classList.remove("wrt-dragging"); }
  };
  canvas.addEventListener("pointerup", drop);
  canvas.addEventListener("pointercancel", drop);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", (event) => ask(event, "fly"));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (!state.camera) return;
    state.flight = null;
    const lines = event.deltaMode === 1 ? 16 : 1;
    look(zoomed(state.camera, Math.exp(Math.max(-200, Math.min(200, event.deltaY * lines)) * 0.0015)));
  }, { passive: false });
  view.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !state.camera) return;
    const own = event.target === canvas || event.target === view;
    if (!own && ["INPUT", "SELECT", "BUTTON", "SUMMARY"].includes(event.target.tagName)) return;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const others = { "+": () => look(zoomed(state.camera, 0.9)), "=": () => look(zoomed(state.camera, 0.9)),
      "-": () => look(zoomed(state.camera, 1 / 0.9)), r: home, f: everything, Escape: () => pick(false),
      h: () => view.classList.toggle("wrt-plain") };
    if (arrows) {
      const [x, y] = arrows;
      look(event.shiftKey ? panned(state.camera, -0.04 * x, -0.04 * y) : orbited(state.camera, 0.06 * x, 0.06 * y));
    } else if (others[event.key]) others[event.key]();
    else return;
    event.preventDefault();
  });

  // A frame is acknowledged once it is drawn, so that no more are sent than this page can draw.
  async function draw(header, bytes) {
    const image = await createImageBitmap(new Blob([bytes], { type: "image/jpeg" }));
    const width = state.width || image.width, height = state.height || image.height;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    context.imageSmoothingQuality = header.moving ? "low" : "high";
    context.drawImage(image, 0, 0, width, height);
    image.close();
    link.send({ type: "ack", frame: header.frame });
    state.frames += 1;
    state.header = header;
    if (header.moving) return;
    bar.max = header.target;
    bar.value = header.spp;
    samples.textContent = `${header.spp} of ${header.target} samples${header.denoised ? ", denoised" : ""}`;
    noise.textContent = header.noise == null ? "" : `noise ${(100 * header.noise).toPrecision(2)} %`;
    speed.textContent = header.paths_per_second == null ? "" : `${short(header.paths_per_second)}paths/s`;
  }

  function save(name, bytes) { // by the browser, as a download
    const file = URL.createObjectURL(new Blob([bytes]));
    element("a", { href: file, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(file), 10000);
    say(`${name} saved.`);
  }

  link.receive = async (message, bytes) => {
    if (message.type === "frame") {
      try {
        await draw(message, bytes);
      } catch (error) {
        link.send({ type: "ack", frame: message.frame });
        fail(`A frame cannot be shown: ${error.message}`);
      }
    } else if (message.type === "file") save(message.name, bytes);
    else if (message.type === "state") {
      fail(message.error);
      heading.textContent = message.name || "wrt";
      if (title && message.name) document.title = `${message.name} – wrt view`;
      // While a hand moves the camera here, the server's copy is older.
      if (message.camera && !drag && !due) state.camera = message.camera;
      Object.assign(state, { home: message.home, bounds: message.bounds, width: message.width, height: message.height });
      layer.value = message.settings.layer;
      const listed = new Set([...integrator.options].map((option) => option.value));
      for (const name of message.own_integrators) if (!listed.has(name)) integrator.append(...options({ [name]: name }));
      integrator.value = message.settings.integrator ?? "";
      integrator.options[0].textContent = message.integrator ? `Scene's own (${message.integrator})` : "Scene's own";
      if (document.activeElement !== depth) depth.value = message.settings.max_depth ?? "";
      const stops = typeof message.exposure === "number" ? message.exposure : null;
      if (document.activeElement !== exposure || stops === null) exposure.value = stops ?? 0;
      exposed.value = stops === null ? "auto" : stops.toFixed(1);
      tone.value = message.tone;
      denoise.checked = state.denoise = message.denoise;
    } else if (message.type === "picked") {
      const { picked, action } = message;
      if (!picked) return say("Nothing is there.");
      if (action === "fly") { say(picked.name); fly(framed(state.camera, picked.bounds)); }
      else {
        const lens = state.camera.aperture_radius > 0;
        say(`Focus at ${picked.distance.toPrecision(4)} on ${picked.name}${lens ? "" : "; a pinhole camera is sharp everywhere"}`);
        if ("focus_distance" in state.camera) look({ ...state.camera, focus_distance: picked.distance });
      }
    } else if (message.type === "toml") {
      try {
        await navigator.clipboard.writeText(message.text);
        say("The camera is in the clipboard.");
      } catch {
        say("The browser keeps the clipboard closed.");
        prompt("The camera", message.text.trim().replaceAll("\n", "; "));
      }
    } else if (message.type === "error") {
      say(message.text);
      denoise.checked = state.denoise;
    }
  };
  link.lost = (text) => fail(text);
  async function still(address) {
    const image = new Image();
    image.src = address;
    await image.decode();
    if (state.frames) return;
    Object.assign(canvas, { width: image.width, height: image.height });
    context.drawImage(image, 0, 0);
  }
  return { state, look, view, still };
}

function parsed(buffer) { // see wrt/view/server.py
  const size = new DataView(buffer).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  return [message, new Uint8Array(buffer, 4 + size)];
}

// The page of `wrt view`: a WebSocket that is opened again when it breaks.
function page(root) {
  const token = new URLSearchParams(location.search).get("token") ?? "";
  const link = {};
  let socket = null, wait = 250;
  link.send = (message) => { if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };
  const shown = mount(root, link);
  function connect() {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live?token=${encodeURIComponent(token)}`);
    socket.binaryType = "arraybuffer";
    let opened = false;
    socket.onopen = () => { opened = true; wait = 250; link.lost(""); };
    socket.onmessage = ({ data }) => link.receive(...(typeof data === "string" ? [JSON.parse(data)] : parsed(data)));
    socket.onclose = () => {
      link.lost(opened || wait > 250 ? "The connection is lost; wrt view may have ended. Trying again…"
        : "No connection: is the address the one that wrt view has printed, with its token?");
      setTimeout(connect, wait);
      wait = Math.min(4000, wait * 1.6);
    };
  }
  connect();
  globalThis.wrtView = { ...shown, link, close: () => socket.close() };
}

// The widget of notebooks, for anywidget.
function render({ model, el }) {
  const link = { send: (message) => model.send(message) };
  const last = model.get("snapshot"); // of a saved notebook, where nothing may answer
  const shown = mount(el, link, { title: false });
  const listen = (message, buffers) => link.receive(message, buffers?.[0]);
  model.on("msg:custom", listen);
  if (last) shown.still(`data:image/png;base64,${last}`);
  globalThis.wrtWidget = { ...shown, link };
  link.send({ type: "open" });
  return () => model.off("msg:custom", listen);
}

export default { render };

const root = document.getElementById("view");
if (root) page(root);
