// Follows the page of examples/web, which shows a pack: is every body where the animation of the result has it? The
// shader itself is asked: it writes points of each body into a texture of floats. Sends the answer home.
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import { POSE } from "./pile.js";

const send = (answer) => fetch("/answer", { method: "POST", body: JSON.stringify(answer) });

// Points of each body, in its frame: beside the origin, so that its rotation counts, as far away as a prop is large.
const POINTS = 4;

async function check() {
  while (!window.cairn) await new Promise((then) => setTimeout(then, 50));
  if (window.cairn.error) throw new Error(window.cairn.error);
  const { THREE, pile, renderer, scene: page, camera, show } = window.cairn;
  renderer.setAnimationLoop(null);
  const { bodies, files } = pile.manifest;
  const { draws } = files.find(({ file }) => file === "instances.glb");
  const { scene, animations } = await new GLTFLoader().loadAsync("/work/pile.glb");
  const mixer = new THREE.AnimationMixer(scene);
  const play = (moment) => {
    // An action that has come to its end stays there unless it is begun again.
    for (const clip of animations) {
      const action = mixer.clipAction(clip).setLoop(THREE.LoopOnce).reset();
      action.clampWhenFinished = true;
      action.play();
    }
    mixer.setTime(moment);
  };
  const nodes = scene.getObjectByName("pile").children;
  if (nodes.length !== bodies) throw new Error(`${nodes.length} nodes, ${bodies} bodies`);
  // The half diagonal of the largest prop.
  const reach = Math.max(...pile.object.children.flatMap(meshes).map((mesh) => sphere(mesh)));
  const points = [[0, 0, 0], [reach, 0, 0], [0, reach, 0], [0, 0, reach]];

  const width = 256;
  const height = Math.ceil((bodies * POINTS) / width);
  const target = new THREE.WebGLRenderTarget(width, height, { type: THREE.FloatType, depthBuffer: false });
  const material = new THREE.RawShaderMaterial({
    glslVersion: THREE.GLSL3,
    uniforms: { ...pile.uniforms, points: { value: points.flat() } },
    vertexShader: "in vec3 position; void main() { gl_Position = vec4(position, 1.0); }",
    fragmentShader: `precision highp float; precision highp int; ${POSE}
      uniform float points[${3 * POINTS}]; out vec4 color;
      void main() {
        int at = int(gl_FragCoord.y) * ${width} + int(gl_FragCoord.x);
        int k = 3 * (at % ${POINTS});
        color = vec4(cairn_posed(vec3(points[k], points[k + 1], points[k + 2]), float(min(at / ${POINTS}, ${bodies - 1}))), 1.0);
      }`,
  });
  const quad = new THREE.Mesh(new THREE.PlaneGeometry(2, 2), material);
  quad.frustumCulled = false;
  const read = new Float32Array(4 * width * height);
  const seconds = pile.seconds;
  const moments = [0, 0.31, 0.5, 0.777, 1].map((share) => share * seconds);
  let [worst, moved] = [0, 0];
  let first;
  for (const moment of moments) {
    pile.show(moment);
    renderer.setRenderTarget(target);
    renderer.render(new THREE.Scene().add(quad), new THREE.Camera());
    renderer.readRenderTargetPixels(target, 0, 0, width, height, read);
    renderer.setRenderTarget(null);
    play(moment);
    scene.updateMatrixWorld(true);
    first ??= read.slice();
    nodes.forEach((node, body) => {
      points.forEach((point, k) => {
        const at = 4 * (body * POINTS + k);
        const there = new THREE.Vector3(...point).applyMatrix4(node.matrixWorld);
        worst = Math.max(worst, there.distanceTo(new THREE.Vector3(...read.subarray(at, at + 3))));
        moved = Math.max(moved, Math.hypot(...[0, 1, 2].map((c) => read[at + c] - first[at + c])));
      });
    });
  }
  show(0.5 * seconds);
  const { calls, triangles } = renderer.info.render;
  const picture = renderer.domElement.toDataURL("image/png");
  // The page itself: what its picture covers, against that of the animation.
  const ours = covered(renderer);
  play(0.5 * seconds);
  page.remove(pile.object);
  scene.getObjectByName("scenery")?.removeFromParent();
  page.add(scene);
  renderer.render(page, camera);
  const theirs = covered(renderer);
  const shown = theirs.filter(Boolean).length;
  const differing = ours.filter((is, at) => is !== theirs[at]).length;
  await send({ revision: THREE.REVISION, bodies, draws, worst, moved, calls, triangles, shown, differing, picture });
}

// Whether each picture element is not as the first one, which is the background.
function covered(renderer) {
  const gl = renderer.getContext();
  const bytes = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
  gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  const all = new Uint32Array(bytes.buffer);
  return Array.from(all, (pixel) => pixel !== all[0]);
}

function meshes(node) {
  return node.isMesh ? [node] : node.children.flatMap(meshes);
}

function sphere(mesh) {
  mesh.geometry.computeBoundingSphere();
  return mesh.geometry.boundingSphere.center.length() + mesh.geometry.boundingSphere.radius;
}

check().catch((error) => send({ error: String(error.stack ?? error) }));
