// The state of the page, and what happens when it changes.

const MOVE_MS = 1400;
const STEP_PX = 70;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function initialState(model) {
  const placement = Math.max(model.after, 0);
  return {
    placement,
    transform: model.placements[placement].transform,
    colour: "survey", heat: "none", image: "none", swipe: 0.5, exaggeration: 10, selected: null,
    layers: { reference: true, source: true, pairs: false, residuals: false, alone: true, rows: false, gaps: true, boundary: true },
  };
}

function loadPictures(model, loaded) {
  const pictures = {};
  for (const survey of Object.values(model.surveys)) {
    if (!survey.image?.url.startsWith("data:image/")) continue;
    const picture = new Image();
    picture.addEventListener("load", () => { pictures[survey.role] = picture; loaded(); });
    picture.src = survey.image.url;
  }
  return pictures;
}

class Report {
  constructor(model) {
    this.model = model;
    this.state = initialState(model);
    this.canvas = byId("map");
    this.stage = byId("stage");
    this.tip = byId("tip");
    this.pick = makePicker(model);
    this.zoomState = d3.zoomIdentity;
    this.pictures = loadPictures(model, () => this.redraw());
    this.resize();
    this.zoom = makeZoom(this.canvas, (transform) => {
      this.zoomState = transform;
      this.redraw();
    });
    this.listen();
    fillHeader(model);
    fillTables(model);
    fillRivals(model, (index) => {
      this.lay(index);
      this.stage.scrollIntoView({ block: "center" });
    });
    fillPlacements(model, this.state, (index) => this.lay(index));
    fillControls(model, this.state, (change) => {
      change();
      this.describe();
      this.redraw();
    });
    this.describe();
    drawHistograms(model, this.placement);
    this.draw();
  }

  get placement() {
    return this.model.placements[this.state.placement];
  }

  get view() {
    return zoomed(this.whole, this.zoomState);
  }

  listen() {
    new ResizeObserver(() => { this.resize(); this.redraw(); }).observe(this.stage);
    for (const query of ["print", "(prefers-color-scheme: dark)"]) {
      matchMedia(query).addEventListener("change", () => { this.describe(); this.resize(); this.draw(); });
    }
    addEventListener("beforeprint", () => { this.resize(); this.draw(); });
    byId("closer").addEventListener("click", () => this.zoom.by(1.6));
    byId("farther").addEventListener("click", () => this.zoom.by(1 / 1.6));
    byId("fit").addEventListener("click", () => this.zoom.reset());
    byId("play").addEventListener("click", () => this.play());
    this.canvas.addEventListener("pointermove", (event) => { if (event.pointerType === "mouse" && !event.buttons) this.point(event); });
    this.canvas.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") this.select(null); });
    this.canvas.addEventListener("click", (event) => this.point(event));
    this.canvas.addEventListener("keydown", (event) => this.key(event));
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(1, Math.round(width * ratio));
    this.canvas.height = Math.max(1, Math.round(height * ratio));
    this.ratio = ratio;
    this.whole = wholeView(this.model, this.model.placements[Math.max(this.model.after, 0)].transform, width, height);
  }

  redraw() {
    this.frame ??= requestAnimationFrame(() => this.draw());
  }

  // What stands beside the map: legend, texts, and which controls matter.
  describe() {
    const { state, model } = this;
    this.colours = theme();
    this.colouring = colouring(model, state.colour, this.placement, this.colours);
    const entries = [...this.colouring.legend];
    if (state.heat !== "none") entries.push(...ramp(model, state.heat).legend.map((entry) => ({ ...entry, text: `heat map, ${entry.text}` })));
    const counts = countsOf(this.placement);
    if (state.layers.alone) {
      entries.push({ text: `✕ missing in ${model.source.name} (${counts.missing})`, colour: WONG.vermillion, line: true });
      entries.push({ text: `+ new in ${model.source.name} (${counts.new})`, colour: WONG.purple, line: true });
    }
    if (state.layers.gaps && available(model, "gaps")) entries.push({ text: `◇ gaps in rows (${model.rows.gaps.length})`, colour: this.colours.ink, line: true });
    if (state.layers.pairs) entries.push({ text: "from where a tree lies now to its partner", colour: WONG.green, line: true });
    if (state.layers.residuals) entries.push({ text: `residuals, drawn ${state.exaggeration} times as long`, colour: this.colours.ink, line: true });
    fillLegend(entries);
    byId("swipe-row").hidden = state.image !== "swipe";
    byId("exaggeration-text").textContent = `${state.exaggeration} times as long`;
    this.heat = state.heat === "none" ? null : heatMap(model, state.heat, this.placement.transform, model.data.spacing_m || 1);
  }

  draw() {
    cancelAnimationFrame(this.frame);
    this.frame = undefined;
    const ctx = this.canvas.getContext("2d");
    const { view, state, model, colours } = this;
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    ctx.fillStyle = colours.ground;
    ctx.fillRect(0, 0, view.width, view.height);
    this.drawGround(ctx, view);
    const over = state.image !== "none" || this.heat;
    const look = { colourOf: this.colouring.of, fill: over ? 0 : 0.5, lineWidth: over ? 1.6 : 1 };
    if (state.layers.reference) drawCrowns(ctx, view, model.reference, IDENTITY, look);
    if (state.layers.source) drawCrowns(ctx, view, model.source, state.transform, { ...look, fill: over ? 0 : 0.35 });
    this.drawMarked(ctx, view);
    drawScale(ctx, view, `${roundLength(120 / view.scale)} m`, roundLength(120 / view.scale), 0, colours.ink, colours.paper);
    if (state.layers.residuals) {
      const length = roundLength(120 / view.scale / state.exaggeration);
      drawScale(ctx, view, `${metres(length)} of a residual`, length * state.exaggeration, 24, colours.ink, colours.paper);
    }
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
      ctx.fillStyle = this.colours.paper;
      ctx.fillRect(edge - 1.5, 0, 3, view.height);
    }
    if (state.image === "source") this.drawPicture(ctx, view, model.source, state.transform);
    if (this.heat) drawHeat(ctx, view, this.heat);
    if (state.layers.boundary) drawLines(ctx, view, model.boundary, WONG.grey, 1.5);
  }

  drawPicture(ctx, view, survey, transform) {
    const picture = this.pictures[survey.role];
    if (picture) drawImage(ctx, view, picture, survey, transform);
  }

  drawMarked(ctx, view) {
    const { state, model, colours, placement } = this;
    const { source, reference } = model;
    if (state.layers.rows && model.rows) drawRows(ctx, view, model, state.transform);
    if (state.layers.gaps && model.rows) drawMarks(ctx, view, model.rows.gaps.map(([x, y]) => [x / 100, y / 100]), "diamond", colours.ink, colours.paper);
    if (state.layers.alone) {
      drawMarks(ctx, view, alone(model, placement, "reference", IDENTITY), "cross", WONG.vermillion, colours.paper);
      drawMarks(ctx, view, alone(model, placement, "source", state.transform), "plus", WONG.purple, colours.paper);
    }
    const partners = (of) => d3.range(source.size).filter((i) => of.source[i] >= 0);
    if (state.layers.pairs && model.after >= 0) {
      const chosen = model.placements[model.after];
      drawLines(ctx, view, partners(chosen).map((i) => [
        moved(state.transform, source.x[i], source.y[i]), [reference.x[chosen.source[i]], reference.y[chosen.source[i]]],
      ]), WONG.green, 2);
    }
    if (state.layers.residuals) {
      drawLines(ctx, view, partners(placement).map((i) => {
        const [east, north] = residual(model, placement, i);
        const [x, y] = [reference.x[placement.source[i]], reference.y[placement.source[i]]];
        return [[x - state.exaggeration * east, y - state.exaggeration * north], [x, y]];
      }), colours.ink, 1.5);
    }
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

  lay(index) {
    const from = this.state.transform;
    this.state.placement = index;
    for (const radio of document.getElementsByName("placement")) radio.checked = Number(radio.value) === index;
    this.moving?.stop();
    this.describe();
    drawHistograms(this.model, this.placement);
    this.select(this.state.selected);
    this.moving = animate(MOVE_MS, (share) => {
      this.state.transform = share === 1 ? this.placement.transform : between(from, this.placement.transform, share);
      this.redraw();
    });
  }

  // From before to the placement that is shown, or to the one found.
  play() {
    const target = this.state.placement || Math.max(this.model.after, 1);
    this.state.transform = this.model.placements[0].transform;
    this.lay(target);
  }

  shownRoles() {
    return ["reference", "source"].filter((role) => this.state.layers[role]);
  }

  at(px, py, pixels) {
    const { view } = this;
    const [x, y] = moved(inverse(screenFrom(view)), px, py);
    const reach = Math.max(pixels / view.scale, d3.median(this.model.reference.radius));
    return this.pick(x, y, reach, this.shownRoles(), this.state.transform);
  }

  point(event) {
    const box = this.canvas.getBoundingClientRect();
    this.select(this.at(event.clientX - box.left, event.clientY - box.top, event.pointerType === "touch" ? 24 : 10));
  }

  select(selected) {
    this.state.selected = selected;
    if (selected) {
      showTip(this.tip, treeFacts(this.model, this.placement, selected));
      placeTip(this.tip, ...this.screenOf(selected.role, selected.tree), this.view.width, this.view.height);
    } else {
      this.tip.hidden = true;
    }
    this.redraw();
  }

  key(event) {
    const arrow = ARROWS[event.key];
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (arrow && event.shiftKey) this.zoom.pan(-arrow[0] * STEP_PX, arrow[1] * STEP_PX, this.zoomState.k);
    else if (arrow) this.step(arrow);
    else if (event.key === "+" || event.key === "=") this.zoom.by(1.6);
    else if (event.key === "-") this.zoom.by(1 / 1.6);
    else if (event.key === "0") this.zoom.reset();
    else if (event.key === " ") this.lay(this.state.placement === 0 ? Math.max(this.model.after, 0) : 0);
    else if (event.key === "Escape") this.select(null);
    else return;
    event.preventDefault();
  }

  // The next tree that way; at first the one nearest to the middle of the map.
  step(arrow) {
    const { selected, transform } = this.state;
    const { width, height } = this.view;
    const next = selected ? neighbour(this.model, selected, transform, arrow) : this.at(width / 2, height / 2, Infinity);
    if (!next) return;
    const [x, y] = this.screenOf(next.role, next.tree);
    const aside = (at, size) => (at < 0.1 * size || at > 0.9 * size ? size / 2 - at : 0);
    const [dx, dy] = [aside(x, width), aside(y, height)];
    if (dx || dy) this.zoom.pan(dx, dy, this.zoomState.k);
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
