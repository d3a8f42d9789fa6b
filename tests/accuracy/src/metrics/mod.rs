//! Error metrics of pictures and of sequences.
//!
//! Every spatial function takes the picture under test first and the reference second. NaN and infinity are errors that name the pixel, as
//! are pictures that differ in size. `docs/metrics.md` has the formulas.

mod compare;
mod draw;
mod error;
mod flip;
mod picture;
mod spatial;
mod ssim;
mod temporal;

pub use compare::Comparison;
pub use draw::{DynamicRange, side_by_side};
pub use error::MetricError;
pub use flip::{Exposures, FLIP_PIXELS_PER_DEGREE, exposures, flip_hdr, flip_hdr_map, flip_ldr, flip_ldr_map, magma};
pub use picture::{Map, Picture};
pub use spatial::{
    RELMSE_EPSILON, SMAPE_EPSILON, mse, psnr, psnr_of_mse, relmse, relmse_map, rmse, smape, smape_map,
    squared_error_map,
};
pub use ssim::{ssim, ssim_map};
pub use temporal::{Disocclusion, Flicker, Ghosting, Lag, disocclusion, flicker, flicker_map, ghosting, lag};
