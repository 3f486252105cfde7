// The contact sheet's 3-D view: shows a result of Cairn on a canvas and plays it. `build-viewer` makes viewer.min.js of this file and
// three.js.

import {
  AnimationMixer, Box3, Clock, Color, DirectionalLight, HemisphereLight, LoopOnce, Mesh, PCFSoftShadowMap, PerspectiveCamera,
  PlaneGeometry, Scene, ShadowMaterial, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

const GROUND = new Color(0xe9e6e1);

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFSoftShadowMap;
    this.camera = new PerspectiveCamera(35, 1, 0.01, 1000);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.maxPolarAngle = Math.PI / 2 - 0.02;
    this.clock = new Clock();
    this.playing = false;
    this.onTime = () => {};
    this.renderer.setAnimationLoop(() => this.frame());
  }

  // Loads the bytes of a .glb, and plays it from the beginning.
  async show(bytes) {
    const { scene: model, animations } = await new GLTFLoader().parseAsync(bytes, "");
    const scene = new Scene();
    scene.background = GROUND;
    scene.add(model);
    model.traverse((node) => {
      if (node.isMesh) node.castShadow = node.receiveShadow = true;
    });
    this.mixer = new AnimationMixer(model);
    this.duration = Math.max(0, ...animations.map((clip) => clip.duration));
    this.actions = animations.map((clip) => this.mixer.clipAction(clip).setLoop(LoopOnce));
    for (const action of this.actions) {
      action.clampWhenFinished = true;
      action.play();
    }
    const pile = model.getObjectByName("pile") ?? model;
    const box = new Box3();
    for (const time of [this.duration, 0]) {
      this.place(time);
      model.updateMatrixWorld(true);
      box.union(new Box3().setFromObject(pile));
    }
    const lowest = Math.min(box.min.y, new Box3().setFromObject(model).min.y);
    const size = box.getSize(new Vector3()).length() || 1;
    const middle = box.getCenter(new Vector3());

    const ground = new Mesh(new PlaneGeometry(40 * size, 40 * size), new ShadowMaterial({ opacity: 0.28 }));
    ground.rotation.x = -Math.PI / 2;
    ground.position.set(middle.x, lowest - 0.001 * size, middle.z);
    ground.receiveShadow = true;
    scene.add(ground, new HemisphereLight(0xffffff, 0xb8aea0, 1.6));
    const sun = new DirectionalLight(0xfff4e4, 2.6);
    sun.position.copy(middle).add(new Vector3(0.7, 1.3, 0.9).multiplyScalar(size));
    sun.target.position.copy(middle);
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.bias = -0.0005;
    sun.shadow.normalBias = 0.002 * size;
    const { camera: lens } = sun.shadow;
    [lens.left, lens.right, lens.top, lens.bottom, lens.near, lens.far] = [-size, size, size, -size, 0.1 * size, 4 * size];
    scene.add(sun, sun.target);

    [this.camera.near, this.camera.far] = [0.005 * size, 60 * size];
    this.camera.position.copy(middle).add(new Vector3(0.55, 0.42, 1).normalize().multiplyScalar(1.9 * size));
    this.controls.target.copy(middle);
    this.controls.minDistance = 0.2 * size;
    this.controls.maxDistance = 8 * size;
    this.scene = scene;
    this.time = 0;
    this.playing = this.duration > 0;
    this.fit();
  }

  // Where the animation stands, in seconds.
  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.place(this.time);
    this.onTime(this.time);
  }

  // An action that has come to its end would stay there.
  place(time) {
    for (const action of this.actions) action.reset();
    this.mixer.setTime(time);
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const pixels = Math.min(window.devicePixelRatio, 2);
    if (!width || (this.canvas.width === Math.floor(width * pixels) && this.canvas.height === Math.floor(height * pixels))) return;
    this.renderer.setPixelRatio(pixels);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  frame() {
    const passed = this.clock.getDelta();
    if (!this.scene) return;
    this.fit();
    if (this.playing) {
      // A moment to look at the end, then again.
      const next = this.time + passed;
      this.holding = next > this.duration ? (this.holding ?? 0) + passed : 0;
      this.seek(this.holding > 1.5 ? 0 : next);
    }
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
  }
}
