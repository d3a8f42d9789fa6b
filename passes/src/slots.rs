//! The slots of the frame: one table, in the order in which [`frame`](crate::frame::frame()) adds them.
//!
//! A slot consists of a line of this table, its contract in [`contracts`], a folder with a function `slot()` that lists its implementations,
//! and a line of `frame()` that connects it.
use crate::contracts;
use crate::outputs::Gives;
use crate::parts::light_tree::LightTree;
use crate::parts::previous_radiance::PreviousRadiance;
use crate::parts::reproject::Reprojection;
use magpie::config::{Catalogue, Config};
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Implementation, Needs, Slot, SlotError, SlotInfo, SlotNeeds};

/// Generates, from one list of slots, the types and functions that have an entry for each slot.
macro_rules! slots {
    ($($(#[$about:meta])* $name:ident: $In:ident => $Out:ident,)*) => {
        /// Every slot of the frame with its implementations. [`Slot::register`] adds more.
        #[derive(Clone, Debug)]
        pub struct Slots {
            $($(#[$about])* pub $name: Slot<contracts::$In, contracts::$Out>,)*
            /// Slots of the application, which adds their effects to frames itself: with them here, one configuration names the
            /// implementations of all.
            pub others: Vec<SlotInfo>,
        }

        impl Default for Slots {
            fn default() -> Self {
                Self { $($name: crate::$name::slot(),)* others: Vec::new() }
            }
        }

        impl Slots {
            /// Names of the slots that have a main image, in the order of the frame.
            pub(crate) fn with_images() -> Vec<&'static str> {
                let all = [$((stringify!($name), <contracts::$Out as Gives>::SHOWN),)*];
                all.into_iter().filter(|(_, shown)| *shown).map(|(name, _)| name).collect()
            }

            /// Describes every slot, in the order of the frame.
            pub fn infos(&self) -> Vec<SlotInfo> {
                let mut infos = vec![$(self.$name.info().clone(),)*];
                infos.extend_from_slice(&self.others);
                infos
            }
        }

        /// The implementation in every slot, ready to declare frames.
        pub struct Frame {
            $(pub(crate) $name: Implementation<contracts::$In, contracts::$Out>,)*
            pub(crate) light_tree: LightTree,
            pub(crate) reprojection: Reprojection,
            pub(crate) previous_radiance: PreviousRadiance,
        }

        impl Frame {
            /// Creates the implementation that `config` names for every slot.
            ///
            /// # Errors
            /// [`SlotError`] for an unknown name or setting, or a shader or pipeline that could not be created.
            pub fn new(build: &Build<'_>, slots: &Slots, config: &Config) -> Result<Self, SlotError> {
                Ok(Self {
                    $($name: slots.$name.from_config(build, config)?,)*
                    light_tree: LightTree::new(build)?,
                    reprojection: Reprojection::new(build)?,
                    previous_radiance: PreviousRadiance::new(build)?,
                })
            }

            /// Replaces the implementations that differ in name or settings from what `config` says. All others are kept, together with
            /// their histories.
            ///
            /// # Errors
            /// As [`Frame::new`]; nothing has changed in that case.
            pub fn configure(&mut self, build: &Build<'_>, slots: &Slots, config: &Config) -> Result<(), SlotError> {
                // All new implementations are created before any is put in place, so that an error changes nothing.
                let changes = [$(slots.$name.change(&mut self.$name, build, config)?,)*];
                changes.into_iter().flatten().for_each(|change| change());
                Ok(())
            }

            /// Lets `build` note the pipelines of all implementations that [`Frame::configure`] would create, and of the parts that they share.
            ///
            /// # Errors
            /// As [`Frame::new`].
            pub fn rehearse(&self, build: &Build<'_>, slots: &Slots, config: &Config) -> Result<(), SlotError> {
                let changes = [$(slots.$name.rehearse(&self.$name, build, config)?,)*];
                if changes.contains(&true) {
                    LightTree::new(build)?;
                    Reprojection::new(build)?;
                    PreviousRadiance::new(build)?;
                }
                Ok(())
            }

            /// The needs of each implementation for a scene, in the order of the frame.
            pub fn needs(&self, facts: &SceneFacts) -> Vec<SlotNeeds> {
                vec![$(SlotNeeds {
                    slot: stringify!($name),
                    implementation: self.$name.implementation().to_owned(),
                    needs: self.$name.needs(facts),
                },)*]
            }
        }
    };
}

slots! {
    /// Updates the scene's geometry and acceleration structures.
    acceleration: AccelerationIn => AccelerationOut,
    /// Shows the cost of ray traversal.
    rays: RaysIn => RaysOut,
    /// Images of the surfaces that the camera sees first.
    gbuffer: GBufferIn => GBuffer,
    /// Visibility of lights.
    shadows: ShadowIn => ShadowOut,
    /// Ambient occlusion.
    ao: AoIn => AoOut,
    /// Direct light and emission.
    direct: DirectIn => DirectOut,
    /// Diffuse indirect light.
    gi: LightingIn => LightingOut,
    /// Specular indirect light.
    reflections: LightingIn => LightingOut,
    /// The sum of all light.
    compose: ComposeIn => ComposeOut,
    /// The background.
    sky: SkyIn => SkyOut,
    /// Anti-aliasing, exposure and tone curve: from radiance to display values.
    post: PostIn => PostOut,
}

/// The merged needs of all slots.
pub fn merged(needs: &[SlotNeeds]) -> Needs {
    needs.iter().fold(Needs::default(), |all, slot| all.and(slot.needs.clone()))
}

impl Slots {
    /// The catalogue of slots, implementations and settings, against which configurations are checked.
    pub fn catalogue(&self) -> Catalogue {
        Catalogue::new(self.infos())
    }
}
