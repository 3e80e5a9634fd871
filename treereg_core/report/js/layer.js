// A layer is drawn a little with every frame, and shown under any later view and placement once it is done: so panning,
// zooming and the move stay smooth however many trees there are.

const MARGIN = 0.4; // of the view, drawn beyond each of its edges

class Layer {
  constructor(paint) {
    this.paint = paint;
    this.front = null;
  }

  // Draws the layer anew, step by step; gives what becomes its `front`.
  *prepare(view, ratio, placed) {
    const [x, y] = [Math.round(MARGIN * view.width), Math.round(MARGIN * view.height)];
    const wide = {
      scale: view.scale, left: view.left + x, top: view.top + y, width: view.width + 2 * x, height: view.height + 2 * y,
    };
    const canvas = Object.assign(document.createElement("canvas"), { width: wide.width * ratio, height: wide.height * ratio });
    const ctx = canvas.getContext("2d");
    ctx.scale(ratio, ratio);
    yield* this.paint(ctx, wide, placed);
    return { canvas, view: wide, placed };
  }

  show(ctx, view, placed) {
    if (!this.front) return;
    const then = compose(screenFrom(this.front.view), this.front.placed);
    const t = compose(compose(screenFrom(view), placed), inverse(then));
    ctx.save();
    ctx.transform(t.a, t.b, t.c, t.d, t.e, t.f);
    ctx.drawImage(this.front.canvas, 0, 0, this.front.view.width, this.front.view.height);
    ctx.restore();
  }
}
