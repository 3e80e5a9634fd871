// Where on the canvas the ground lies, and what moves it.

// The view that shows every tree, of the reference and of the source as it is placed.
function wholeView(model, transform, width, height) {
  const xs = [...d3.extent(model.reference.x)];
  const ys = [...d3.extent(model.reference.y)];
  for (let i = 0; i < model.source.size; i++) {
    const [x, y] = moved(transform, model.source.x[i], model.source.y[i]);
    if (x < xs[0]) xs[0] = x;
    if (x > xs[1]) xs[1] = x;
    if (y < ys[0]) ys[0] = y;
    if (y > ys[1]) ys[1] = y;
  }
  return fitting(xs, ys, width, height);
}

// The view that shows the ground between these eastings and northings, metres.
function fitting(xs, ys, width, height) {
  const margin = 0.03 * Math.max(xs[1] - xs[0], ys[1] - ys[0], 10);
  const [w, h] = [xs[1] - xs[0] + 2 * margin, ys[1] - ys[0] + 2 * margin];
  const scale = Math.min(width / w, height / h);
  return {
    scale, width, height,
    left: width / 2 - (scale * (xs[0] + xs[1])) / 2,
    top: height / 2 + (scale * (ys[0] + ys[1])) / 2,
  };
}

// The same view after a zoom of d3's.
function zoomed(view, { k, x, y }) {
  return { ...view, scale: view.scale * k, left: view.left * k + x, top: view.top * k + y };
}

// Zoom by wheel, pinch and drag, but for events that are `taken`; `changed` is called with every step.
function makeZoom(canvas, taken, changed) {
  const meant = (event) => (!event.ctrlKey || event.type === "wheel") && !event.button && !taken(event);
  const zoom = d3.zoom().filter(meant).scaleExtent([0.4, 400]).on("zoom", ({ transform }) => changed(transform));
  const selection = d3.select(canvas).call(zoom).on("dblclick.zoom", null);
  return {
    by: (factor) => zoom.scaleBy(selection, factor),
    pan: (dx, dy, k) => zoom.translateBy(selection, dx / k, dy / k),
    reset: () => selection.call(zoom.transform, d3.zoomIdentity),
  };
}

// Runs `step` with shares from 0 to 1 over so many milliseconds; gives a way to stop it.
function animate(milliseconds, step) {
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) {
    step(1);
    return { stop() {} };
  }
  const timer = d3.timer((elapsed) => {
    const share = Math.min(1, elapsed / milliseconds);
    step(d3.easeCubicInOut(share));
    if (share === 1) timer.stop();
  });
  return timer;
}
