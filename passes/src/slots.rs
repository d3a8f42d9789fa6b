//! The slots of the frame: one table, in the order in which [`frame`](crate::frame::frame()) goes through them.
//!
//! A slot is a line of this table, its contract in [`contracts`], a folder with a function `slot()` that says what can fill it, and a line of
//! `frame()` that wires it.
use crate::contracts;
use crate::outputs::Gives;
use crate::parts::previous_radiance::PreviousRadiance;
use crate::parts::reproject::Reprojection;
use magpie::config::{Catalogue, Config};
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Implementation, Needs, Slot, SlotError, SlotInfo, SlotNeeds};

/// Makes from one list of slots all that holds one thing for each of them.
macro_rules! slots {
    ($($(#[$about:meta])* $name:ident: $In:ident => $Out:ident,)*) => {
        /// Every slot of the frame with all that can fill it. A user adds more with [`Slot::register`].
        #[derive(Clone, Debug)]
        pub struct Slots {
            $($(#[$about])* pub $name: Slot<contracts::$In, contracts::$Out>,)*
        }

        impl Default for Slots {
            fn default() -> Self {
                Self { $($name: crate::$name::slot(),)* }
            }
        }

        impl Slots {
            /// Those that have an image which stands for what they do, in the order of the frame.
            pub(crate) fn with_images() -> Vec<&'static str> {
                let all = [$((stringify!($name), <contracts::$Out as Gives>::SHOWN),)*];
                all.into_iter().filter(|(_, shown)| *shown).map(|(name, _)| name).collect()
            }

            /// Describes every slot, in the order of the frame.
            pub fn infos(&self) -> Vec<SlotInfo> {
                vec![$(self.$name.info().clone(),)*]
            }
        }

        /// A frame that can be declared: an implementation in every slot.
        pub struct Frame {
            $(pub(crate) $name: Implementation<contracts::$In, contracts::$Out>,)*
            pub(crate) reprojection: Reprojection,
            pub(crate) previous_radiance: PreviousRadiance,
        }

        impl Frame {
            /// Fills every slot with the implementation that `config` names.
            ///
            /// # Errors
            /// [`SlotError`] for an unknown name or setting, or a faulty shader.
            pub fn new(build: &Build<'_>, slots: &Slots, config: &Config) -> Result<Self, SlotError> {
                Ok(Self {
                    $($name: slots.$name.from_config(build, config)?,)*
                    reprojection: Reprojection::new(build)?,
                    previous_radiance: PreviousRadiance::new(build)?,
                })
            }

            /// Puts what `config` names into the slots where that is another implementation or has other settings. The others keep their
            /// instances, and with them their histories.
            ///
            /// # Errors
            /// As [`Frame::new`]; then nothing has changed.
            pub fn configure(&mut self, build: &Build<'_>, slots: &Slots, config: &Config) -> Result<(), SlotError> {
                // Everything is made before anything takes its place.
                let changes = [$(slots.$name.change(&mut self.$name, build, config)?,)*];
                changes.into_iter().flatten().for_each(|change| change());
                Ok(())
            }

            /// What each implementation asks for in such a scene, in the order of the frame.
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
    /// The scene as rays see it.
    acceleration: AccelerationIn => AccelerationOut,
    /// How much work rays are.
    rays: RaysIn => RaysOut,
    /// What the camera sees first.
    gbuffer: GBufferIn => GBuffer,
    /// How much of each light is seen.
    shadows: ShadowIn => ShadowOut,
    /// What is left of the hemisphere above each pixel.
    ao: AoIn => AoOut,
    /// Light straight from the lights.
    direct: DirectIn => DirectOut,
    /// Diffuse indirect light.
    gi: LightingIn => LightingOut,
    /// Specular indirect light.
    reflections: LightingIn => LightingOut,
    /// The sum of all light.
    compose: ComposeIn => ComposeOut,
    /// What lies behind everything.
    sky: SkyIn => SkyOut,
    /// From radiance to a display.
    post: PostIn => PostOut,
}

/// What all slots together ask for.
pub fn merged(needs: &[SlotNeeds]) -> Needs {
    needs.iter().fold(Needs::default(), |all, slot| all.and(slot.needs.clone()))
}

impl Slots {
    /// What a configuration is checked against.
    pub fn catalogue(&self) -> Catalogue {
        Catalogue::new(self.infos())
    }
}
