// What is on the canvas: images and heat map, layers of canopies and marks, and what is selected.

const SLICE_MS = 9; // of each frame, for drawing layers
const REST_MS = 110; // without a move of the view, before layers are drawn anew

class Scene {
  constructor(canvas, model, state) {
    Object.assign(this, { canvas, model, state, zoomState: d3.zoomIdentity, pictures: {}, moving: false, printing: false });
    this.layers = {
      reference: new Layer((ctx, view) => this.paintReference(ctx, view)),
      source: new Layer((ctx, view, placed) => this.paintSource(ctx, view, placed)),
      marks: new Layer((ctx, view) => this.paintMarks(ctx, view)),
    };
    this.loadPictures();
    this.resize();
  }

  get placement() {
    return this.model.placements[this.state.placement];
  }

  get view() {
    return zoomed(this.whole, this.zoomState);
  }

  loadPictures() {
    for (const survey of Object.values(this.model.surveys)) {
      if (!survey.image?.url.startsWith("data:image/")) continue;
      const picture = new Image();
      picture.addEventListener("load", () => {
        this.pictures[survey.role] = picture;
        this.redraw();
      });
      picture.src = survey.image.url;
    }
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    this.ratio = Math.min(devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(1, Math.round(width * this.ratio));
    this.canvas.height = Math.max(1, Math.round(height * this.ratio));
    const home = this.model.placements[Math.max(this.model.after, 0)].transform;
    this.whole = wholeView(this.model, home, width, height);
  }

  zoomTo(transform) {
    this.zoomState = transform;
    this.redraw();
    this.refresh(REST_MS);
  }

  // The layers are out of date: draw them anew, unless that is asked for again within so many milliseconds.
  refresh(delay = 0) {
    clearTimeout(this.rest);
    this.job = null;
    this.rest = setTimeout(() => {
      this.job = this.prepare();
      this.redraw();
    }, delay);
  }

  redraw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = undefined;
      this.work(SLICE_MS);
      this.draw();
      if (this.job) this.redraw();
    });
  }

  // Everything at once, for print.
  drawNow() {
    clearTimeout(this.rest);
    this.job = this.prepare();
    this.work(Infinity);
    this.draw();
  }

  work(milliseconds) {
    if (this.moving) return;
    const end = performance.now() + milliseconds;
    while (this.job && performance.now() < end) if (this.job.next().done) this.job = null;
  }

  *prepare() {
    const { view, ratio } = this;
    const placed = this.state.transform;
    const fronts = {};
    for (const [name, layer] of Object.entries(this.layers)) {
      fronts[name] = yield* layer.prepare(view, ratio, name === "source" ? placed : IDENTITY);
    }
    for (const [name, layer] of Object.entries(this.layers)) layer.front = fronts[name];
    this.canvas.dataset.drawn = String(Number(this.canvas.dataset.drawn ?? 0) + 1);
  }

  // Colours as they are to be now.
  recolour() {
    this.colours = theme(this.printing);
    this.colouring = colouring(this.model, this.state.colour, this.placement, this.colours);
    this.heat = this.state.heat === "none"
      ? null
      : heatMap(this.model, this.state.heat, this.placement.transform);
  }

  get look() {
    const over = this.state.image !== "none" || this.heat;
    return { colourOf: this.colouring.of, fill: over ? 0 : 0.5, lineWidth: over ? 1.6 : 1 };
  }

  *paintReference(ctx, view) {
    if (this.state.layers.reference) yield* drawCrowns(ctx, view, this.model.reference, IDENTITY, this.look);
  }

  *paintSource(ctx, view, placed) {
    const { state, model, colours, placement, look } = this;
    if (!state.layers.source) return;
    yield* drawCrowns(ctx, view, model.source, placed, { ...look, fill: 0.7 * look.fill });
    if (state.layers.alone) {
      const sign = { shape: "plus", colour: WONG.purple, paper: colours.paper };
      yield* drawMarks(ctx, view, alone(model, placement, "source", placed), sign);
    }
  }

  *paintMarks(ctx, view) {
    const { state, model, colours, placement } = this;
    if (state.layers.rows && model.rows) drawRows(ctx, view, model, state.transform);
    yield;
    if (state.layers.gaps && model.rows) {
      const gaps = model.rows.gaps.map(([x, y]) => [x / 100, y / 100]);
      yield* drawMarks(ctx, view, gaps, { shape: "diamond", colour: colours.ink, paper: colours.paper });
    }
    if (state.layers.alone && state.layers.reference) {
      const sign = { shape: "cross", colour: WONG.vermillion, paper: colours.paper };
      yield* drawMarks(ctx, view, alone(model, placement, "reference", IDENTITY), sign);
    }
    if (state.layers.residuals) yield* drawLines(ctx, view, this.residualLines(), colours.ink, 1.5);
  }

  draw() {
    const ctx = this.canvas.getContext("2d");
    const { view, state, model, colours, layers } = this;
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    ctx.fillStyle = colours.ground;
    ctx.fillRect(0, 0, view.width, view.height);
    this.drawGround(ctx, view);
    layers.reference.show(ctx, view, IDENTITY);
    layers.source.show(ctx, view, state.transform);
    if (state.layers.pairs && model.after >= 0) finish(drawLines(ctx, view, this.pairLines(), WONG.green, 2));
    if (!this.moving) layers.marks.show(ctx, view, IDENTITY);
    drawScale(ctx, view, { times: 1, what: "", lift: 0 }, colours);
    if (state.layers.residuals) {
      drawScale(ctx, view, { times: state.exaggeration, what: " of a residual", lift: 24 }, colours);
    }
    if (state.image === "swipe") drawEdge(ctx, view, state.swipe, colours);
    this.drawSelected(ctx, view);
  }

  drawGround(ctx, view) {
    const { state, model } = this;
    if (state.image === "reference" || state.image === "swipe") this.drawPicture(ctx, view, model.reference, IDENTITY);
    if (state.image === "swipe") {
      const edge = state.swipe * view.width;
      ctx.save();
      ctx.beginPath();
      ctx.rect(edge, 0, view.width - edge, view.height);
      ctx.clip();
      ctx.fillStyle = this.colours.ground;
      ctx.fillRect(edge, 0, view.width - edge, view.height);
      this.drawPicture(ctx, view, model.source, state.transform);
      ctx.restore();
    }
    if (state.image === "source") this.drawPicture(ctx, view, model.source, state.transform);
    if (this.heat) drawHeat(ctx, view, this.heat);
    if (state.layers.boundary) finish(drawLines(ctx, view, model.boundary, WONG.grey, 1.5));
  }

  drawPicture(ctx, view, survey, transform) {
    const picture = this.pictures[survey.role];
    if (picture) drawImage(ctx, view, picture, survey, transform);
  }

  // From where each source tree lies now to its partner under the placement that was found.
  pairLines() {
    const { source, reference, placements, after } = this.model;
    const partner = placements[after].source;
    return d3.range(source.size).filter((i) => partner[i] >= 0).map((i) => [
      moved(this.state.transform, source.x[i], source.y[i]), [reference.x[partner[i]], reference.y[partner[i]]],
    ]);
  }

  residualLines() {
    const { model, placement } = this;
    const { reference, source } = model;
    const times = this.state.exaggeration;
    return d3.range(source.size).filter((i) => placement.source[i] >= 0).map((i) => {
      const [east, north] = residual(model, placement, i);
      const [x, y] = [reference.x[placement.source[i]], reference.y[placement.source[i]]];
      return [[x - times * east, y - times * north], [x, y]];
    });
  }

  drawSelected(ctx, view) {
    const { selected } = this.state;
    if (!selected) return;
    const t = this.toScreen(selected.role);
    for (const [width, colour] of [[6, this.colours.paper], [3, this.colours.ink]]) {
      ctx.lineWidth = width;
      ctx.strokeStyle = colour;
      ctx.beginPath();
      addCrown(ctx, this.model.surveys[selected.role], selected.tree, t, view.scale);
      ctx.stroke();
    }
  }

  toScreen(role) {
    return compose(screenFrom(this.view), role === "source" ? this.state.transform : IDENTITY);
  }

  // Where a tree lies on the canvas, pixels.
  screenOf(role, tree) {
    const survey = this.model.surveys[role];
    return moved(this.toScreen(role), survey.x[tree], survey.y[tree]);
  }
}
