// The trees as one survey shows them.

class Scene extends Stage {
  constructor(canvas, model, state) {
    super(canvas, model, state);
    this.layers = { crowns: new Layer((ctx, view) => this.paintCrowns(ctx, view)), marks: new Layer((ctx, view) => this.paintMarks(ctx, view)) };
    this.resize();
  }

  get survey() {
    return this.model.timeline[this.state.survey];
  }

  wholeView(width, height) {
    return fitting(d3.extent(this.survey.x), d3.extent(this.survey.y), width, height);
  }

  placedBy() {
    return IDENTITY;
  }

  recolour() {
    this.colours = theme(this.printing);
    this.growth = this.survey.growth[this.state.colour] ?? null;
    this.scale = this.state.colour === "state" ? null : growthColours(this.model, this.state.colour, this.colours);
  }

  // The colour of a tree's crown; null when only its outline can be drawn.
  colourOf(tree) {
    const { survey, scale, growth } = this;
    if (survey.area_m2[tree] === null) return null;
    if (!scale) return STATES[survey.state[tree]].colour;
    const share = growth?.[tree] ?? null;
    return share === null ? null : scale.of(share);
  }

  *paintCrowns(ctx, view) {
    const { survey, state } = this;
    const shown = d3.range(survey.size).filter((tree) => state.layers[survey.state[tree]]);
    const full = part(survey, shown.filter((tree) => this.colourOf(tree)));
    const outlined = part(survey, shown.filter((tree) => !this.colourOf(tree)));
    yield* drawCrowns(ctx, view, outlined, IDENTITY, { colourOf: () => WONG.grey, fill: 0, lineWidth: 1.2 });
    const colourOf = ({ tree }, k) => this.colourOf(tree[k]);
    yield* drawCrowns(ctx, view, full, IDENTITY, { colourOf, fill: 0.75, lineWidth: 1 });
  }

  *paintMarks(ctx, view) {
    const { survey, state, colours } = this;
    if (this.scale) return; // signs would hide how the trees around them grow
    for (const [name, { shape, colour }] of Object.entries(STATES)) {
      if (!shape || !state.layers[name]) continue;
      const points = d3.range(survey.size).filter((i) => survey.state[i] === name).map((i) => [survey.x[i], survey.y[i]]);
      yield* drawMarks(ctx, view, points, { shape, colour, paper: colours.paper });
    }
  }

  draw() {
    const ctx = this.canvas.getContext("2d");
    const { view, colours, layers, state } = this;
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    ctx.fillStyle = colours.ground;
    ctx.fillRect(0, 0, view.width, view.height);
    layers.crowns.show(ctx, view, IDENTITY);
    layers.marks.show(ctx, view, IDENTITY);
    drawScale(ctx, view, { times: 1, what: "", lift: 0 }, colours);
    if (state.opened) this.drawRing(ctx, view, state.opened.tree, 3);
    if (state.selected) this.drawRing(ctx, view, state.selected.tree, 1.5);
  }

  drawRing(ctx, view, tree, width) {
    const [x, y] = this.screenOf("trees", tree);
    const r = Math.max(this.survey.radius[tree] * view.scale, MARK + 2) + width;
    for (const [extra, colour] of [[3, this.colours.paper], [0, this.colours.ink]]) {
      ctx.lineWidth = width + extra;
      ctx.strokeStyle = colour;
      ctx.beginPath();
      ctx.arc(x, y, r, 0, 2 * Math.PI);
      ctx.stroke();
    }
  }

  // Where a tree lies on the canvas, pixels.
  screenOf(_, tree) {
    return moved(screenFrom(this.view), this.survey.x[tree], this.survey.y[tree]);
  }
}

// Some trees of a survey, to be drawn.
function part({ x, y, radius, usualRadius }, tree) {
  const of = (values) => tree.map((i) => values[i]);
  return { tree, size: tree.length, x: of(x), y: of(y), radius: of(radius), usualRadius, outline: null };
}
