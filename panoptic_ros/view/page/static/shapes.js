// Many rods, balls and ellipsoids, each kind in one call to the graphics card.

import { CylinderGeometry, DynamicDrawUsage, InstancedMesh, Matrix4, MeshLambertMaterial, Quaternion, SphereGeometry, Vector3 } from "#view/vendor/three.js";

const UP = new Vector3(0, 1, 0);

// Instances of one geometry; as many as are added between `begin` and `end`.
class Many {
  constructor(group, geometry, material) {
    this.group = group;
    this.geometry = geometry;
    this.material = material;
    this._grow(256);
    this.matrix = new Matrix4();
  }

  begin() {
    this.count = 0;
  }

  put(color) {
    if (this.count === this.mesh.instanceMatrix.count) this._grow(2 * this.count);
    this.mesh.setMatrixAt(this.count, this.matrix);
    this.mesh.setColorAt(this.count, color);
    this.count += 1;
  }

  end() {
    this.mesh.count = this.count;
    this.mesh.visible = this.count > 0;
    this.mesh.instanceMatrix.needsUpdate = true;
    if (this.mesh.instanceColor) this.mesh.instanceColor.needsUpdate = true;
  }

  _grow(capacity) {
    const old = this.mesh;
    this.mesh = new InstancedMesh(this.geometry, this.material, capacity);
    this.mesh.instanceMatrix.setUsage(DynamicDrawUsage);
    this.mesh.frustumCulled = false;
    this.mesh.count = 0;
    if (old) {
      for (let i = 0; i < this.count; i++) {
        const matrix = new Matrix4();
        old.getMatrixAt(i, matrix);
        this.mesh.setMatrixAt(i, matrix);
      }
      if (old.instanceColor) {
        this.mesh.setColorAt(0, this.material.color);
        this.mesh.instanceColor.array.set(old.instanceColor.array);
      }
      this.group.remove(old);
      old.dispose();
    }
    this.group.add(this.mesh);
  }
}

export class Rods extends Many {
  constructor(group, material = new MeshLambertMaterial()) {
    super(group, new CylinderGeometry(1, 1, 1, 8, 1, true), material);
    this.a = new Vector3();
    this.b = new Vector3();
    this.turn = new Quaternion();
  }

  add(a, b, radius, color) {
    this.a.set(...a);
    this.b.set(...b).sub(this.a);
    const length = this.b.length();
    if (length < 1e-6) return;
    this.turn.setFromUnitVectors(UP, this.b.clone().divideScalar(length));
    this.a.addScaledVector(this.b, 0.5);
    this.matrix.compose(this.a, this.turn, new Vector3(radius, length, radius));
    this.put(color);
  }
}

// Round plates, thin, that face along a normal.
export class Discs extends Many {
  constructor(group, material = new MeshLambertMaterial()) {
    super(group, new CylinderGeometry(1, 1, 1, 10), material);
    this.at = new Vector3();
    this.normal = new Vector3();
    this.turn = new Quaternion();
  }

  add(at, normal, radius, color) {
    this.turn.setFromUnitVectors(UP, this.normal.set(...normal));
    this.matrix.compose(this.at.set(...at), this.turn, new Vector3(radius, 0.15 * radius, radius));
    this.put(color);
  }
}

export class Balls extends Many {
  constructor(group, material = new MeshLambertMaterial()) {
    super(group, new SphereGeometry(1, 12, 8), material);
  }

  add([x, y, z], radius, color) {
    this.matrix.makeScale(radius, radius, radius).setPosition(x, y, z);
    this.put(color);
  }

  // The image of the unit ball under a matrix, by rows.
  addTurned([x, y, z], [a, b, c, d, e, f, g, h, i], color) {
    this.matrix.set(a, b, c, x, d, e, f, y, g, h, i, z, 0, 0, 0, 1);
    this.put(color);
  }

  // The image of the unit ball under a lower triangular matrix, see `cholesky`.
  addEllipsoid([x, y, z], [l00, l10, l20, l11, l21, l22], scale, color) {
    this.matrix.set(scale * l00, 0, 0, x, scale * l10, scale * l11, 0, y, scale * l20, scale * l21, scale * l22, z, 0, 0, 0, 1);
    this.put(color);
  }
}
