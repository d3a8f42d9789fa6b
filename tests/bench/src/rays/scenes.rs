//! Benchmark of rendering effects' rays on whole scenes.
use super::{
    Case, Contender, Quantity, Question, RayBenchError, RayTable, Run, Surfaces, Target,
    agreement::{BackendAnswers, agreement_of_closest},
    bounds, extent_of, primary, random,
};
use glam::Vec3;
use magpie::ray::Bounds;
use magpie::scene::{ResidentOptions, ResidentScene, Scene, SharedScene};
use magpie_shaders::Rays;

/// Label suffix for structures without compaction.
pub(super) const NOT_COMPACTED: &str = ", not compacted";

impl Run<'_> {
    /// Primary, shadow, ambient-occlusion, diffuse-bounce and random rays.
    pub fn scene(&mut self, scene: &Scene) -> Result<(), RayBenchError> {
        let triangles: usize = scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].indices.len() / 3).sum();
        let case = |variant: &str| Case::new("scene", scene.name.as_str(), triangles as f64, variant);
        (self.progress)(&format!("{}: building", scene.name));
        let ways = self.tracer.ways();
        let driver = ways.iter().copied().find(|w| *w != Rays::Software);
        let software =
            ways.contains(&Rays::Software).then(|| self.resident(scene, Rays::Software, true)).transpose()?;
        let compacted = driver.map(|rays| self.resident(scene, rays, true)).transpose()?;
        let loose = driver.map(|rays| self.resident(scene, rays, false)).transpose()?;
        for (resident, by, variant) in [
            (&software, "software", "build"),
            (&compacted, "driver", "build"),
            (&loose, "driver", "build, not compacted"),
        ] {
            let Some(report) = resident.as_ref().map(|r| r.borrow().acceleration()) else { continue };
            for (quantity, value) in [
                (Quantity::BuildBottom, report.bottom_ms),
                (Quantity::BuildTop, report.top_ms),
                (Quantity::BottomBytes, report.bottom_bytes as f64),
                (Quantity::TopBytes, report.top_bytes as f64),
            ] {
                self.report.add(&case(variant), by, quantity, vec![value], 0);
            }
        }

        let mut contenders = Vec::new();
        for rays in ways {
            let resident = if rays == Rays::Software { &software } else { &compacted };
            contenders.extend(resident.iter().map(|r| Contender { rays, target: Target::Scene(r), note: "" }));
        }
        if let (Some(rays), Some(loose)) = (driver, &loose) {
            contenders.push(Contender { rays, target: Target::Scene(loose), note: NOT_COMPACTED });
        }
        for (kind, table) in self.tables(scene, &contenders)? {
            (self.progress)(&format!("{}: {kind} rays", scene.name));
            self.race(&case(kind), &contenders, &table, self.effort.repeats)?;
            // Sorting may help incoherent rays.
            if ["bounce", "random"].contains(&kind) {
                self.sorted(&case(kind), &contenders, &table)?;
            }
        }
        Ok(())
    }

    /// The same rays in sorted order: cost of sorting, and its gain.
    fn sorted(&mut self, case: &Case, contenders: &[Contender<'_>], table: &RayTable) -> Result<(), RayBenchError> {
        let origins: Vec<Vec3> = table.rays.iter().map(|r| r.origin.into()).collect();
        let bounds = Bounds::of_points(&origins);
        let table = self.tracer.upload(table)?;
        let of = |variant: &str| Case { variant: format!("{}, {variant}", case.variant), ..case.clone() };
        for contender in contenders.iter().filter(|c| c.note.is_empty()) {
            let Contender { rays, target, .. } = *contender;
            let (mut sorts, mut traces, mut both) = (Vec::new(), Vec::new(), Vec::new());
            let rate = |ns: u64| table.count() as f64 * 1e3 / ns.max(1) as f64;
            for turn in 0..=self.effort.setup_repeats {
                let (sort, trace) = self.tracer.time_sorted(rays, target, &table, &bounds)?;
                if turn > 0 {
                    sorts.push(sort as f64 * 1e-6);
                    traces.push(rate(trace));
                    both.push(rate(sort + trace));
                }
            }
            self.report.add(&of("sorted"), rays.name(), Quantity::Sort, sorts, table.count());
            self.report.add(&of("sorted"), rays.name(), Quantity::Rate, traces, table.count());
            self.report.add(&of("sorted, with the sort"), rays.name(), Quantity::Rate, both, table.count());
            if table.question() == Question::Closest {
                let plain = self.tracer.closest(rays, target, &table)?;
                let sorted = self.tracer.closest_sorted(rays, target, &table, &bounds)?;
                let plain = BackendAnswers::new(format!("{rays}"), &plain);
                let sorted = BackendAnswers::new(format!("{rays}, sorted"), &sorted);
                self.report.agreement.push(agreement_of_closest(&of("sorted"), plain, sorted));
            }
        }
        Ok(())
    }

    fn resident(&self, scene: &Scene, rays: Rays, compaction: bool) -> Result<SharedScene, RayBenchError> {
        let options = ResidentOptions { rays, compaction, ..ResidentOptions::default() };
        let failed = |source| RayBenchError::Scene { scene: scene.name.clone(), source };
        Ok(ResidentScene::new(self.tracer.gpu(), scene, options).map_err(failed)?.shared())
    }

    /// Tables of every kind of ray. The hits of primary rays are found once, by the first backend.
    fn tables(
        &mut self,
        scene: &Scene,
        contenders: &[Contender<'_>],
    ) -> Result<Vec<(&'static str, RayTable)>, RayBenchError> {
        let (Some(camera), Some(first)) = (scene.cameras.first(), contenders.first()) else { return Ok(Vec::new()) };
        let extent = extent_of(self.effort.size);
        let seen = primary(camera, extent);
        let on_device = self.tracer.upload(&seen)?;
        let answers = self.tracer.closest(first.rays, first.target, &on_device)?;
        let surfaces = Surfaces::new(scene, &seen, &answers);
        let key_light = match first.target {
            Target::Scene(resident) => {
                resident.borrow().shadow_lights().first().and_then(|c| scene.lights.get(c.light as usize))
            }
            Target::World(_) => None,
        };
        let none = || RayTable::of(Vec::new(), Question::Any);
        Ok(vec![
            ("primary", seen),
            ("shadow", key_light.map_or_else(none, |light| surfaces.shadow(light))),
            ("occlusion", surfaces.occlusion()),
            ("bounce", surfaces.bounce()),
            ("random", random(bounds(scene), extent, 1)),
        ])
    }
}
