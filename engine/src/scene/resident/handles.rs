//! The scene's resources as handles of one frame.
use crate::graph::{Buffer, BufferToken, Handle, PassBuilder, Tlas, TraceToken};

/// The scene's resources as one frame's graph knows them.
#[derive(Clone, Copy, Debug)]
pub struct SceneHandles {
    /// Root, instances and lights.
    pub state: Handle<Buffer>,
    /// Meshes and materials.
    pub tables: Handle<Buffer>,
    /// Positions and attributes of every mesh.
    pub vertices: Handle<Buffer>,
    /// Those of meshes that deform, as they are in this frame.
    pub deformed: Option<Handle<Buffer>>,
    /// Indices of every mesh, one after another.
    pub indices: Handle<Buffer>,
    /// Table by which emissive triangles and spheres are sampled: [`LightTables`](magpie_shaders::light_sampling::LightTables) with only
    /// `near` and `emitters` set. `None` if nothing emits, or no effect [asked](crate::slot::Needs::emitters) for it.
    pub emitters: Option<Handle<Buffer>>,
    /// Tables by which every light is sampled: [`LightTables`](magpie_shaders::light_sampling::LightTables). `None` if no effect
    /// [asked](crate::slot::Needs::light_tables) for them.
    pub lights: Option<Handle<Buffer>>,
    /// The light tree: [`LightTree`](magpie_shaders::light_tree::LightTree). `None` if there are no lights for it, or no effect
    /// [asked](crate::slot::Needs::light_tree) for it.
    pub light_tree: Option<Handle<Buffer>>,
    /// The acceleration structure.
    pub tlas: Handle<Tlas>,
    /// What a walk of it reads beside: bottom levels, those of meshes that keep their shape first.
    pub bottom: [Option<Handle<Buffer>>; 2],
}

impl SceneHandles {
    /// Declares that a pass looks up what the scene is made of. The token is that of the state, which begins with the root: its id is the
    /// address of the [`Scene`](magpie_shaders::scene::Scene), which shaders have from nowhere else.
    pub fn read(self, p: &mut PassBuilder<'_>) -> BufferToken {
        p.read(self.tables);
        p.read(self.vertices);
        p.read(self.indices);
        if let Some(deformed) = self.deformed {
            p.read(deformed);
        }
        p.read(self.state)
    }

    /// Declares that a pass traces rays, and looks up what they hit.
    pub fn trace(self, p: &mut PassBuilder<'_>) -> SceneToken {
        let root = self.read(p);
        for bottom in self.bottom.into_iter().flatten() {
            p.read(bottom);
        }
        SceneToken { root, tlas: p.trace(self.tlas) }
    }
}

/// What a pass declared with [`SceneHandles::trace`].
#[derive(Clone, Copy, Debug)]
pub struct SceneToken {
    /// As [`SceneHandles::read`] gives it.
    pub root: BufferToken,
    /// What rays walk.
    pub tlas: TraceToken,
}
