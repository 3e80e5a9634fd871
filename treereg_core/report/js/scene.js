// What is on the canvas: images and heat map, layers of canopies and marks, and what is selected.

class Scene extends Stage {
  constructor(canvas, model, state) {
    super(canvas, model, state);
    this.pictures = {};
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

  wholeView(width, height) {
    return wholeView(this.model, this.model.placements[Math.max(this.model.after, 0)].transform, width, height);
  }

  placedBy(layer) {
    return layer === "source" ? this.state.transform : IDENTITY;
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
