// The state of the page, and what happens when it changes.

const MOVE_MS = 1400;
const STEP_PX = 70;
const CLOSER = 1.6;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function initialState(model) {
  const placement = Math.max(model.after, 0);
  return {
    placement,
    transform: model.placements[placement].transform,
    colour: "survey", heat: "none", image: "none", swipe: 0.5, exaggeration: 5, selected: null,
    layers: { reference: true, source: true, pairs: false, residuals: false, alone: true, rows: false, gaps: true, boundary: true },
  };
}

class Report {
  constructor(model) {
    this.model = model;
    this.state = initialState(model);
    this.canvas = byId("map");
    this.tip = byId("tip");
    this.pick = makePicker(model);
    this.scene = new Scene(this.canvas, model, this.state);
    this.swipe = makeSwipe(this.canvas, this.state, () => this.scene.redraw());
    const onEdge = (event) => event.type !== "wheel" && this.swipe.near(event);
    this.zoom = makeZoom(this.canvas, onEdge, (transform) => {
      this.scene.zoomTo(transform);
      this.moveTip();
    });
    this.fill();
    this.describe();
    this.listen();
    this.scene.draw();
  }

  get placement() {
    return this.scene.placement;
  }

  fill() {
    const { model, state } = this;
    fillHeader(model);
    fillTables(model);
    fillRivals(model, (index) => {
      this.lay(index);
      this.canvas.scrollIntoView({ block: "center" });
    });
    fillPlacements(model, state, (index) => this.lay(index));
    fillControls(model, state, (change) => {
      change();
      this.describe();
    });
    drawHistograms(model, this.placement);
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
    byId("play").addEventListener("click", () => this.play());
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

  // The state has changed: legend, texts, which controls matter, and the layers.
  describe() {
    const { state, model, scene } = this;
    scene.recolour();
    fillLegend(legendOf(model, state, scene));
    byId("swipe-row").hidden = state.image !== "swipe";
    byId("exaggeration-text").textContent = `${state.exaggeration} times as long`;
    scene.refresh();
    scene.redraw();
  }

  lay(index) {
    const { scene, state } = this;
    const from = state.transform;
    this.move?.stop();
    state.placement = index;
    for (const radio of document.getElementsByName("placement")) radio.checked = Number(radio.value) === index;
    drawHistograms(this.model, this.placement);
    scene.moving = true;
    this.move = animate(MOVE_MS, (share) => {
      const target = this.placement.transform;
      state.transform = share === 1 ? target : between(from, target, share);
      scene.redraw();
      if (share < 1) return;
      scene.moving = false;
      this.describe();
      this.select(state.selected);
    });
  }

  // From before to the placement that is shown, or to the one found.
  play() {
    const target = this.state.placement || Math.max(this.model.after, 1);
    this.state.transform = this.model.placements[0].transform;
    this.lay(target);
  }

  // The tree at a place on the canvas, among those of the surveys that are shown.
  at(px, py, pixels) {
    const { view } = this.scene;
    const [x, y] = moved(inverse(screenFrom(view)), px, py);
    const reach = Math.max(pixels / view.scale, this.model.reference.usualRadius);
    const roles = ["reference", "source"].filter((role) => this.state.layers[role]);
    return this.pick({ x, y, reach, roles, transform: this.state.transform });
  }

  point(event) {
    const box = this.canvas.getBoundingClientRect();
    this.select(this.at(event.clientX - box.left, event.clientY - box.top, event.pointerType === "touch" ? 24 : 10));
  }

  select(selected) {
    this.state.selected = selected;
    if (selected) showTip(this.tip, treeFacts(this.model, this.placement, selected));
    else this.tip.hidden = true;
    this.moveTip();
    this.scene.redraw();
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
    else if (event.key === " ") this.lay(this.state.placement === 0 ? Math.max(this.model.after, 0) : 0);
    else if (event.key === "Escape") this.select(null);
    else return;
    event.preventDefault();
  }

  // The next tree that way; at first the one nearest to the middle of the map.
  step(arrow) {
    const { selected, transform } = this.state;
    const { width, height } = this.scene.view;
    const next = selected ? neighbour(this.model, selected, transform, arrow) : this.at(width / 2, height / 2, Infinity);
    if (!next) return;
    const [x, y] = this.scene.screenOf(next.role, next.tree);
    const aside = (at, size) => (at < 0.1 * size || at > 0.9 * size ? size / 2 - at : 0);
    const [dx, dy] = [aside(x, width), aside(y, height)];
    if (dx || dy) this.zoom.pan(dx, dy, this.scene.zoomState.k);
    this.select(next);
  }
}

try {
  window.treereg = new Report(decode(readData()));
  document.documentElement.dataset.ready = "yes";
} catch (fault) {
  byId("headline").textContent = "This report cannot be drawn";
  byId("sentence").textContent = "Its data is damaged; make it again with treereg run.";
  byId("sentence").className = "fault";
  document.documentElement.dataset.fault = String(fault);
}
