// The state of the page, and what happens when it changes.

const MOVE_MS = 1400;

function initialState(model) {
  const placement = Math.max(model.after, 0);
  return {
    placement,
    transform: model.placements[placement].transform,
    colour: "survey", heat: "none", image: "none", swipe: 0.5, exaggeration: 5, selected: null,
    layers: { reference: true, source: true, pairs: false, residuals: false, alone: true, rows: false, gaps: true, boundary: true },
  };
}

class Report extends MapPage {
  constructor(model) {
    super(model, initialState(model));
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
    byId("play").addEventListener("click", () => this.play());
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

  onSpace() {
    this.lay(this.state.placement === 0 ? Math.max(this.model.after, 0) : 0);
  }

  // The tree at a place on the canvas, among those of the surveys that are shown.
  at(px, py, pixels) {
    const { view } = this.scene;
    const [x, y] = moved(inverse(screenFrom(view)), px, py);
    const reach = Math.max(pixels / view.scale, this.model.reference.usualRadius);
    const roles = ["reference", "source"].filter((role) => this.state.layers[role]);
    return this.pick({ x, y, reach, roles, transform: this.state.transform });
  }

  select(selected) {
    this.state.selected = selected;
    if (selected) showTip(this.tip, treeFacts(this.model, this.placement, selected));
    else this.tip.hidden = true;
    this.moveTip();
    this.scene.redraw();
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
