// The 2D people as the detector saw them, thin and white.

const COLOR = "rgba(235,240,248,.9)";

export const detected = {
  name: "detected", title: "2D people", on: true, hint: "what the detector saw in each view", keys: [],
  under: true,

  tile(canvas, scene, { view }) {
    if (!view) return;
    const { points, scores, person_count: people, joint_count: joints } = view.message;
    for (let person = 0; person < people; person++) {
      const pixel = (joint) => {
        const at = person * joints + joint;
        return scores[at] > 0 ? [points[2 * at], points[2 * at + 1]] : null;
      };
      for (const [parent, child] of scene.facts.skeleton.bones) {
        const a = pixel(parent), b = pixel(child);
        if (a && b) canvas.line(a, b, COLOR, Math.max(1, 0.45 * canvas.stroke));
      }
    }
  },
};
