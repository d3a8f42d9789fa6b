//! The subject of an estimate: a line of text that identifies the picture, regardless of seed and number of samples.
use super::{Only, ReferenceOptions};
use magpie::scene::{Camera, Mesh, Scene};
use std::fmt::Debug;
use std::hash::{DefaultHasher, Hasher};

/// Version of the models of lights and surfaces. Raise it when a change alters the reference picture of any scene.
const MODEL: u32 = 5;

impl ReferenceOptions {
    /// The subject of estimates with these options. Two estimates of the same subject can be merged if their samples are independent.
    pub fn subject(&self, scene: &Scene, camera: &Camera) -> String {
        let Self { width, height, depth, only, pixel, ao_range, time, single_scattering, .. } = *self;
        let mut fingerprint = Fingerprint::default();
        fingerprint.scene(scene);
        fingerprint.text(camera);
        let range = if only == Only::AmbientOcclusion { format!(", range {ao_range}") } else { String::new() };
        let once = if single_scattering { ", single scattering" } else { "" };
        format!(
            "{} of {} from {}, {width}x{height}, {pixel:?}, depth {depth}{range}, time {time}, model {MODEL}{once}, {:016x}",
            only.name(),
            scene.name,
            camera.name,
            fingerprint.0.finish()
        )
    }
}

/// A hash of the scene and the camera.
#[derive(Default)]
struct Fingerprint(DefaultHasher);

impl Fingerprint {
    fn bytes<T: bytemuck::NoUninit>(&mut self, items: &[T]) {
        self.0.write_usize(items.len());
        self.0.write(bytemuck::cast_slice(items));
    }

    /// Adds a small item by its debug output, which has every digit of floats.
    fn text(&mut self, thing: &impl Debug) {
        self.bytes(format!("{thing:?}").as_bytes());
    }

    fn mesh(&mut self, mesh: &Mesh) {
        self.bytes(&mesh.positions);
        self.bytes(&mesh.normals);
        self.bytes(&mesh.tangents);
        self.bytes(&mesh.uv0);
        self.bytes(&mesh.uv1);
        self.bytes(&mesh.colours);
        self.bytes(&mesh.indices);
        self.text(&(&mesh.influences, &mesh.targets, &mesh.weights, &mesh.spheres));
    }

    fn scene(&mut self, scene: &Scene) {
        scene.meshes.iter().for_each(|m| self.mesh(m));
        for texture in &scene.textures {
            self.text(&(texture.size, texture.colour_space));
            self.bytes(texture.mips.first().map_or(&[], |m| &m[..]));
        }
        self.text(&(&scene.materials, &scene.samplers, &scene.nodes, &scene.skins, &scene.animations));
        self.text(&(&scene.instances, &scene.lights, &scene.light_nodes, &scene.daylight));
        if let Some(map) = &scene.environment {
            self.text(&(map.width, map.height, map.scale, map.turn));
            self.bytes(&map.radiance);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_changes_the_picture_changes_the_subject() {
        let scene = magpie::scene::builtin("cornell").unwrap();
        let camera = scene.cameras[0].clone();
        let options = ReferenceOptions::default();
        let base = options.subject(&scene, &camera);
        assert_eq!(base, ReferenceOptions { seed: 7, ..options }.subject(&scene, &camera));
        let mut moved = scene.clone();
        moved.meshes[0].positions[0].x += 1e-6;
        let mut painted = scene.clone();
        painted.materials[0].base_colour.x += 1e-6;
        let mut lit = scene.clone();
        lit.lights.clear();
        let near = Camera { near: 0.02, ..camera.clone() };
        let far = ReferenceOptions { ao_range: 2.0, ..options };
        assert_eq!(base, far.subject(&scene, &camera), "only ambient occlusion has a range");
        let ao = |options| ReferenceOptions { only: Only::AmbientOcclusion, ..options }.subject(&scene, &camera);
        let subjects = [
            ao(options),
            ao(far),
            options.subject(&moved, &camera),
            options.subject(&painted, &camera),
            options.subject(&lit, &camera),
            options.subject(&scene, &near),
            ReferenceOptions { depth: 2, ..options }.subject(&scene, &camera),
            ReferenceOptions { width: 2, ..options }.subject(&scene, &camera),
            ReferenceOptions { single_scattering: true, ..options }.subject(&scene, &camera),
        ];
        for (at, subject) in subjects.iter().enumerate() {
            assert!(*subject != base && !subjects[..at].contains(subject), "{at}: {subject}");
        }
    }
}
