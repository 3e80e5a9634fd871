// A canvas that shows layers under a view that people move. A scene is a stage with `layers`, `wholeView`, `placedBy` (the
// transform of a layer's trees) and `draw`.

const SLICE_MS = 9; // of each frame, for drawing layers
const REST_MS = 110; // without a move of the view, before layers are drawn anew

class Stage {
  constructor(canvas, model, state) {
    Object.assign(this, { canvas, model, state, zoomState: d3.zoomIdentity, moving: false, printing: false });
  }

  get view() {
    return zoomed(this.whole, this.zoomState);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    this.ratio = Math.min(devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(1, Math.round(width * this.ratio));
    this.canvas.height = Math.max(1, Math.round(height * this.ratio));
    this.whole = this.wholeView(width, height);
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
    const fronts = {};
    for (const [name, layer] of Object.entries(this.layers)) {
      fronts[name] = yield* layer.prepare(view, ratio, this.placedBy(name));
    }
    for (const [name, layer] of Object.entries(this.layers)) layer.front = fronts[name];
    this.canvas.dataset.drawn = String(Number(this.canvas.dataset.drawn ?? 0) + 1);
  }
}
