// A page around a map: pointers, keys, zoom, theme and print. A page has a `scene`, a `zoom`, and says in `describe`, `at`,
// `select` and `onSpace` what they do.

const STEP_PX = 70;
const CLOSER = 1.6;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

class MapPage {
  constructor(model, state) {
    Object.assign(this, { model, state, canvas: byId("map"), tip: byId("tip") });
  }

  listen() {
    const { scene, canvas } = this;
    new ResizeObserver(() => {
      scene.resize();
      scene.draw();
      scene.refresh();
    }).observe(canvas.parentElement);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.describe());
    matchMedia("print").addEventListener("change", ({ matches }) => this.print(matches));
    addEventListener("beforeprint", () => this.print(true));
    addEventListener("afterprint", () => this.print(false));
    byId("closer").addEventListener("click", () => this.zoom.by(CLOSER));
    byId("farther").addEventListener("click", () => this.zoom.by(1 / CLOSER));
    byId("fit").addEventListener("click", () => this.zoom.reset());
    canvas.addEventListener("pointermove", (event) => {
      if (event.pointerType === "mouse" && !event.buttons) this.point(event);
    });
    canvas.addEventListener("pointerleave", (event) => {
      if (event.pointerType === "mouse") this.select(null);
    });
    canvas.addEventListener("click", (event) => this.point(event));
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  // On paper, in light colours, or on the screen again.
  print(printing) {
    this.scene.printing = printing;
    this.scene.resize();
    this.describe();
    this.scene.drawNow();
  }

  point(event) {
    const box = this.canvas.getBoundingClientRect();
    this.select(this.at(event.clientX - box.left, event.clientY - box.top, event.pointerType === "touch" ? 24 : 10));
  }

  moveTip() {
    const { selected } = this.state;
    if (!selected) return;
    const { width, height } = this.scene.view;
    placeTip(this.tip, this.scene.screenOf(selected.role, selected.tree), width, height);
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const arrow = ARROWS[event.key];
    if (arrow && event.shiftKey) this.zoom.pan(-arrow[0] * STEP_PX, arrow[1] * STEP_PX, this.scene.zoomState.k);
    else if (arrow) this.step(arrow);
    else if (event.key === "+" || event.key === "=") this.zoom.by(CLOSER);
    else if (event.key === "-") this.zoom.by(1 / CLOSER);
    else if (event.key === "0") this.zoom.reset();
    else if (event.key === " ") this.onSpace();
    else if (event.key === "Escape") this.select(null);
    else return;
    event.preventDefault();
  }

  // The next tree that way; at first the one nearest to the middle of the map.
  step(arrow) {
    const { selected } = this.state;
    const { width, height } = this.scene.view;
    const next = selected ? neighbour(this.model, selected, this.state.transform, arrow) : this.at(width / 2, height / 2, Infinity);
    if (!next) return;
    const [x, y] = this.scene.screenOf(next.role, next.tree);
    const aside = (at, size) => (at < 0.1 * size || at > 0.9 * size ? size / 2 - at : 0);
    const [dx, dy] = [aside(x, width), aside(y, height)];
    if (dx || dy) this.zoom.pan(dx, dy, this.scene.zoomState.k);
    this.select(next);
  }
}
