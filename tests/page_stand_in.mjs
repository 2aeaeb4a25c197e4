// A page without a browser: its scripts run in Node, on elements that keep what is set and draw
// nothing. It is called with the page's file. A test appends what a reader does; `saved` has the files.

import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
const page = readFileSync(process.argv[2], "utf8");
const find = (pattern) => page.match(pattern)[1];
const attributes = (text) =>
  Object.fromEntries([...text.matchAll(/([\w-]+)="([^"]*)"/g)].map((one) => one.slice(1)));
const elements = new Map(), saved = [], frames = [], timers = [];
const nothing = new Proxy(() => nothing, {
  get: (_, name) => (name === Symbol.toPrimitive ? () => 0 : nothing), set: () => true,
});
const box = () => ({ left: 0, top: 0, width: 400, height: 400 });
const make = (given = {}) => ({
  value: "", ...given, style: {}, dataset: {}, hidden: false, textContent: "", clientWidth: 400, clientHeight: 400,
  classList: nothing, children: [], tBodies: [{ replaceChildren() {} }],
  getContext: () => nothing, captureStream: () => "stream",
  setAttribute(name, value) { this[name] = value; }, getBoundingClientRect: box, append() {},
  appendChild(child) { this.children.push(child); return child; },
  replaceChildren() { this.children = []; },
  get parentElement() { return { querySelector: () => make(), getBoundingClientRect: box }; },
  click() { if (this.download) saved.push(this); },
});
for (const [, text] of page.matchAll(/<\w+\b([^>]*\bid="[^>]*)>/g)) {
  const given = attributes(text);
  elements.set(given.id, make(given));
}
elements.set("data", { textContent: find(/id="data">([^]*?)<\/script>/) });
elements.get("speed").value = 1;
Object.assign(globalThis, {
  document: {
    getElementById: (id) => elements.get(id), querySelectorAll: () => [], documentElement: make(),
    createElement: () => make(), createElementNS: (_, name) => make({ name }), body: make(),
  },
  matchMedia: () => ({ matches: false }), ResizeObserver: class { observe() {} }, devicePixelRatio: 1,
  getComputedStyle: () => ({ color: "black", backgroundColor: "white" }), Option: class {},
  requestAnimationFrame: (draw) => frames.push(draw), setInterval: (act) => timers.push(act),
  MediaRecorder: class {
    constructor() { this.mimeType = "video/webm"; }
    start() { this.ondataavailable({ data: "pictures" }); }
    stop() { this.onstop(); }
  },
});
URL.createObjectURL = (blob) => blob;
writeFileSync("page.mjs", find(/<script type="module">([^]*?)<\/script>/));
await import(pathToFileURL("page.mjs"));
const $ = (id) => elements.get(id);
let now = performance.now();
const pass = (seconds) => { // in pictures of a fiftieth of a second
  for (let k = 0; k < 50 * seconds; k++) for (const draw of frames.splice(0)) draw((now += 20));
};
