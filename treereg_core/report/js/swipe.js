// The swipe between two images: an edge on the map that a slider moves, or a finger or pointer that takes hold of it.

const GRIP = 16; // pixels to both sides of the edge

function makeSwipe(canvas, state, changed) {
  const slider = byId("swipe");
  const across = (event) => {
    const box = canvas.getBoundingClientRect();
    return ((event.touches?.[0] ?? event).clientX - box.left) / box.width;
  };
  const near = (event) => state.image === "swipe" && Math.abs(across(event) - state.swipe) * canvas.clientWidth < GRIP;
  const set = (share) => {
    state.swipe = Math.min(1, Math.max(0, share));
    slider.value = 100 * state.swipe;
    changed();
  };
  let held = false;
  slider.addEventListener("input", () => set(slider.value / 100));
  canvas.addEventListener("pointerdown", (event) => {
    held = near(event);
    if (held) canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    canvas.style.cursor = held || near(event) ? "ew-resize" : "";
    if (held) set(across(event));
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = false; });
  return { near };
}

function drawEdge(ctx, view, share, { ink, paper }) {
  const [x, y] = [share * view.width, view.height / 2];
  ctx.fillStyle = paper;
  ctx.fillRect(x - 1.5, 0, 3, view.height);
  ctx.beginPath();
  ctx.arc(x, y, 13, 0, 2 * Math.PI);
  ctx.fill();
  ctx.strokeStyle = ink;
  ctx.lineWidth = 2;
  ctx.beginPath();
  for (const side of [-1, 1]) {
    ctx.moveTo(x + 4 * side, y - 4);
    ctx.lineTo(x + 8 * side, y);
    ctx.lineTo(x + 4 * side, y + 4);
  }
  ctx.stroke();
}
