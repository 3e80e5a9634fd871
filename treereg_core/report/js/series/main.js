// The state of the page, and what happens when it changes.

const PLAY_MS = 1100;

class SeriesPage extends MapPage {
  constructor(model) {
    super(model, {
      survey: model.timeline.length - 1, transform: IDENTITY, colour: "state", selected: null, opened: null,
      layers: Object.fromEntries(Object.keys(STATES).map((name) => [name, true])),
    });
    this.pick = makePicker(model);
    this.scene = new Scene(this.canvas, model, this.state);
    this.zoom = makeZoom(this.canvas, () => false, (transform) => {
      this.scene.zoomTo(transform);
      this.moveTip();
    });
    fillHeader(model);
    fillTables(model);
    const changed = (change) => {
      change();
      this.describe();
    };
    fillChoices(model, { choose: (survey) => this.choose(survey), changed }, this.state);
    this.describe();
    this.listen();
    byId("play").addEventListener("click", () => this.play());
    this.scene.draw();
  }

  describe() {
    const { scene, state, model } = this;
    scene.recolour();
    fillLegend(legendOf(scene));
    showHistory(model, state.opened?.tree ?? null, scene.colours);
    scene.refresh();
    scene.redraw();
  }

  choose(survey) {
    this.state.survey = survey;
    for (const radio of document.getElementsByName("survey")) radio.checked = Number(radio.value) === survey;
    this.describe();
    this.select(this.state.selected);
  }

  // From the first survey to the last, or no further when it is asked for again.
  play() {
    const playing = this.timer !== undefined;
    clearInterval(this.timer);
    this.timer = undefined;
    byId("play").textContent = playing ? "Play" : "Stop";
    if (playing) return;
    this.choose(0);
    this.timer = setInterval(() => {
      this.choose(this.state.survey + 1);
      if (this.state.survey === this.model.timeline.length - 1) this.play();
    }, PLAY_MS);
  }

  onSpace() {
    this.choose((this.state.survey + 1) % this.model.timeline.length);
  }

  // The tree at a place on the canvas.
  at(px, py, pixels) {
    const { view, survey } = this.scene;
    const [x, y] = moved(inverse(screenFrom(view)), px, py);
    return this.pick({ x, y, reach: Math.max(pixels / view.scale, survey.usualRadius), roles: ["trees"], transform: IDENTITY });
  }

  point(event) {
    super.point(event);
    if (event.type === "click" && this.state.selected) this.open(this.state.selected);
  }

  step(arrow) {
    super.step(arrow);
    if (this.state.selected) this.open(this.state.selected);
  }

  open(tree) {
    this.state.opened = tree;
    showHistory(this.model, tree.tree, this.scene.colours);
    this.scene.redraw();
  }

  select(selected) {
    this.state.selected = selected;
    if (selected) showTip(this.tip, treeFacts(this.model, this.scene.survey, selected.tree));
    else this.tip.hidden = true;
    this.moveTip();
    this.scene.redraw();
  }
}

try {
  window.treereg = new SeriesPage(decode(readData()));
  document.documentElement.dataset.ready = "yes";
} catch (fault) {
  byId("headline").textContent = "This series cannot be drawn";
  byId("sentence").textContent = "Its data is damaged; make it again with treereg series.";
  byId("sentence").className = "fault";
  document.documentElement.dataset.fault = String(fault);
}
