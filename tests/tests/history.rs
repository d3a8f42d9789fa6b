//! Histories and kept buffers, tested by minimal effects: every value over many frames, across resizes, cuts and failures.
use anyhow::{Result, ensure};
use magpie::gpu::Buffer;
use magpie::graph::execute::ExecuteError;
use magpie::graph::{BufferDesc, Extent, Format, HistoryScope, ImageDesc, Part, Queue, Record};
use magpie_tests::harness::gpu;
use rig::{Accumulate, Frame, Rig, words_of};
use std::sync::Arc;

#[path = "history/rig.rs"]
mod rig;

/// Graph switches under which all results must be the same.
const SWITCHES: [&str; 7] = ["", "serial", "no-alias", "no-cache", "no-cull,no-reorder", "no-async", "queues=3"];

const EXTENT: Extent = Extent { width: 21, height: 13 };

/// Runs a test under all switches, on one device.
fn under_all(test: impl Fn(&mut Rig) -> Result<()>) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for words in SWITCHES {
        test(&mut Rig::new(&gpu, words)?).map_err(|e| e.context(format!("--graph {words:?}")))?;
    }
    Ok(())
}

fn full(format: Format) -> Accumulate {
    Accumulate::new("full", ImageDesc::full(format))
}

#[test]
fn an_image_goes_on_from_frame_to_frame_until_something_breaks_it() -> Result<()> {
    under_all(|rig| {
        let mut e = full(Format::R32Float);
        for (frame, valid) in [false, true, true, true].into_iter().enumerate() {
            rig.images(EXTENT, &mut [&mut e], &[valid]).map_err(|e| e.context(format!("frame {frame}")))?;
        }
        let other = Extent::new(34, 5);
        rig.images(other, &mut [&mut e], &[false])?;
        rig.images(other, &mut [&mut e], &[true])?;
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        rig.images(EXTENT, &mut [&mut e], &[true])?;
        rig.executor.cut();
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        rig.images(EXTENT, &mut [&mut e], &[true])?;
        e.swap();
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        rig.images(EXTENT, &mut [&mut e], &[true])?;
        rig.nothing()?;
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        rig.images(EXTENT, &mut [&mut e], &[true])?;
        rig.executor.restart();
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        rig.images(EXTENT, &mut [&mut e], &[true])
    })
}

#[test]
fn sizes_follow_the_frame_or_do_not() -> Result<()> {
    under_all(|rig| {
        let table = Extent::new(9, 4);
        let mut half = Accumulate::new("half", ImageDesc::half(Format::R32Float));
        let mut fixed = Accumulate::new("fixed", ImageDesc::fixed(Format::R32Float, table));
        let mut whole = full(Format::R32Float);
        // Half sizes are rounded up: 22 by 13 has the same half as 21 by 13, so the history continues.
        let steps = [
            ((21, 13), [false, false, false]),
            ((21, 13), [true, true, true]),
            ((22, 13), [true, true, false]),
            ((22, 14), [true, true, false]),
            ((23, 14), [false, true, false]),
            ((23, 14), [true, true, true]),
            ((1, 1), [false, true, false]),
            ((2, 1), [true, true, false]),
            ((1, 1), [true, true, false]),
        ];
        for (step, ((width, height), valid)) in steps.into_iter().enumerate() {
            rig.images(Extent::new(width, height), &mut [&mut half, &mut fixed, &mut whole], &valid)
                .map_err(|e| e.context(format!("step {step}: {width}x{height}")))?;
        }
        Ok(())
    })
}

#[test]
fn instances_do_not_mix() -> Result<()> {
    under_all(|rig| {
        let mut one = Accumulate::new("one", ImageDesc::full(Format::R32Float));
        let mut two = Accumulate::new("two", ImageDesc::full(Format::R32Float));
        rig.images(EXTENT, &mut [&mut one], &[false])?;
        rig.images(EXTENT, &mut [&mut one, &mut two], &[true, false])?;
        rig.images(EXTENT, &mut [&mut two, &mut one], &[true, true])?;
        two.swap();
        rig.images(EXTENT, &mut [&mut one, &mut two], &[true, false])?;
        rig.images(EXTENT, &mut [&mut two], &[true])?;
        rig.images(EXTENT, &mut [&mut one, &mut two], &[false, true])
    })
}

#[test]
fn formats_mips_and_layers() -> Result<()> {
    under_all(|rig| {
        let formats = [
            Format::R8Unorm,
            Format::Rg8Unorm,
            Format::Rgba8Unorm,
            Format::R16Unorm,
            Format::Rg16Unorm,
            Format::Rgba16Unorm,
            Format::Rg16Snorm,
            Format::Rgba16Snorm,
            Format::Rg16Float,
            Format::Rgba16Float,
            Format::Rg32Float,
            Format::Rgba32Float,
            Format::R32Uint,
            Format::Rg32Uint,
        ];
        for format in formats {
            let mut e = full(format);
            for valid in [false, true, true] {
                rig.images(EXTENT, &mut [&mut e], &[valid]).map_err(|e| e.context(format!("{format:?}")))?;
            }
        }
        for (mips, layers) in [(5, 1), (1, 3), (3, 2)] {
            let mut e = Accumulate::new("parts", ImageDesc { mips, layers, ..ImageDesc::full(Format::R32Float) });
            for valid in [false, true, true] {
                rig.images(EXTENT, &mut [&mut e], &[valid])
                    .map_err(|e| e.context(format!("{mips} mips, {layers} layers")))?;
            }
            rig.executor.cut();
            rig.images(EXTENT, &mut [&mut e], &[false])?;
            // The same size with another number of layers is another image.
            e.desc.layers += 1;
            rig.images(EXTENT, &mut [&mut e], &[false])?;
            rig.images(EXTENT, &mut [&mut e], &[true])?;
        }
        Ok(())
    })
}

#[test]
fn depth_and_what_cannot_be_stored_are_copied_into_a_history() -> Result<()> {
    under_all(|rig| {
        for format in [Format::D32Float, Format::Rgba8Srgb] {
            let scope = HistoryScope::new();
            let mut last = 0.0;
            for (frame, cut) in [false, false, false, true, false].into_iter().enumerate() {
                if cut {
                    rig.executor.cut();
                }
                // Of the sRGB encoding only the ends are exact.
                let value = if format.is_depth() { (frame + 1) as f32 / 8.0 } else { 1.0 };
                let ((valid, before), _) = rig.frame(EXTENT, |f| copied(f, &scope, format, value))?;
                let expected = if cut { 0.0 } else { last };
                let seen = words_of(&before, 4 * EXTENT.width * EXTENT.height);
                let good = seen.chunks_exact(4).all(|texel| f32::from_bits(texel[0]) == expected);
                ensure!(good, "{format:?}, frame {frame}: {} is not {expected}", f32::from_bits(seen[0]));
                ensure!(valid == (frame > 0 && !cut), "{format:?}, frame {frame}: valid is {valid}");
                last = value;
            }
        }
        Ok(())
    })
}

/// A history of an attachment, cleared to one value and copied. Returns validity and a buffer with the previous contents.
fn copied(f: &mut Frame<'_>, scope: &HistoryScope, format: Format, value: f32) -> Result<(bool, Arc<Buffer>)> {
    let desc = ImageDesc::full(format);
    let history = f.g.history(scope, "copied", desc);
    let whole = [(Part::ALL.of(1, 1), f.g.extent(history.previous), 0)];
    let before = f.read("copied.before", history.previous, &whole, false)?;
    let drawn = f.g.pass("copied.draw", Queue::Graphics, |p| {
        let image =
            if format.is_depth() { p.depth("image", desc, value).0 } else { p.color("image", desc, [value; 4]).0 };
        (image.read(), |_: &mut Record<'_>| {})
    });
    let next = f.g.pass("copied.copy", Queue::Transfer, |p| {
        let from = p.copy_from(drawn);
        let (next, to) = p.copy_to(history.next);
        (next, move |c: &mut Record<'_>| c.copy_image(from, 0, to, 0))
    });
    f.g.output(next.read());
    Ok((history.valid, before))
}

#[test]
fn words_go_on_as_images_do() -> Result<()> {
    under_all(|rig| {
        let mut scope = HistoryScope::new();
        let mut last = Vec::new();
        let steps = [(100, false), (100, true), (100, true), (7, false), (7, true), (0, false), (7, false), (7, true)];
        for (step, (count, expected)) in steps.into_iter().enumerate() {
            if count == 0 {
                scope = HistoryScope::new();
                continue;
            }
            let ((valid, before, after), _) = rig.frame(EXTENT, |f| f.words(&scope, count))?;
            let (before, after) = (words_of(&before, count), words_of(&after, count));
            ensure!(valid == expected, "step {step}: valid is {valid}");
            ensure!(before == if valid { last } else { vec![0; count as usize] }, "step {step}: {before:?}");
            let more: Vec<u32> = before.iter().zip(1..).map(|(was, more)| was + more).collect();
            ensure!(after == more, "step {step}: {after:?}");
            last = after;
        }
        Ok(())
    })
}

#[test]
fn a_kept_buffer_grows_and_keeps_its_bytes() -> Result<()> {
    under_all(|rig| {
        let scope = HistoryScope::new();
        let mut model: Vec<u32> = Vec::new();
        let mut step = |rig: &mut Rig, count: u32, written: u32, valid: u64| -> Result<()> {
            let ((valid_bytes, words), _) = rig.frame(EXTENT, |f| f.kept(&scope, count, written))?;
            ensure!(valid_bytes == valid, "{valid_bytes} bytes are valid, not {valid}");
            model.resize(model.len().max(count as usize), 0);
            model.iter_mut().zip(1..).take(written as usize).for_each(|(word, more)| *word += more);
            let words = words_of(&words, count);
            ensure!(words == model[..count as usize], "{words:?} instead of {model:?}");
            Ok(())
        };
        step(rig, 25, 20, 0)?;
        step(rig, 25, 25, 100)?;
        // It grows by half of its size, and new space is zeroed.
        step(rig, 27, 26, 100)?;
        step(rig, 37, 30, 150)?;
        rig.executor.cut();
        step(rig, 1000, 900, 150)?;
        step(rig, 3, 2, 4000)?;
        // Asked for less, it keeps its size.
        step(rig, 1000, 10, 4000)?;
        // A frame that fails asks for more; the next one need not get it.
        let failed = rig.frame(EXTENT, |f| {
            f.kept(&scope, 1 << 30, 1)?;
            f.g.kept_buffer(&scope, "kept", BufferDesc::new(4));
            Ok(())
        });
        ensure!(failed.is_err(), "declared twice");
        step(rig, 1000, 1000, 4000)
    })
}

#[test]
fn a_kept_buffer_that_is_left_out_is_forgotten() -> Result<()> {
    under_all(|rig| {
        let scope = HistoryScope::new();
        for _ in 0..2 {
            let ((valid, words), _) = rig.frame(EXTENT, |f| f.kept(&scope, 50, 50))?;
            ensure!(valid == 0, "{valid} bytes are valid");
            ensure!(words_of(&words, 50) == (1..=50).collect::<Vec<u32>>(), "not zeros before");
            rig.nothing()?;
        }
        // A new one takes free memory, without affecting the others.
        let pair = HistoryScope::new();
        let _ = rig.frame(EXTENT, |f| f.words(&pair, 50))?;
        rig.nothing()?;
        let ((valid, words), _) = rig.frame(EXTENT, |f| f.kept(&pair, 50, 50))?;
        ensure!(valid == 0 && words_of(&words, 50)[0] == 1, "{valid} bytes are valid");
        // One name, first for a history pair and then for a kept buffer.
        let one = HistoryScope::new();
        let desc = BufferDesc::new(200);
        rig.frame(EXTENT, |f| {
            let history = f.g.history_buffer(&one, "kept", desc);
            f.copy("before", history.previous, 200)?;
            Ok(())
        })?;
        let ((valid, words), _) = rig.frame(EXTENT, |f| f.kept(&one, 50, 50))?;
        ensure!(valid == 0 && words_of(&words, 50) == (1..=50).collect::<Vec<u32>>(), "{valid} bytes are valid");
        Ok(())
    })
}

#[test]
fn what_is_not_written_is_not_valid() -> Result<()> {
    under_all(|rig| {
        let mut e = full(Format::R32Float);
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        rig.images(EXTENT, &mut [&mut e], &[true])?;
        // Declared and read, but not written by any pass.
        let (valid, _) = rig.frame(EXTENT, |f| {
            let history = f.g.history(&e.scope, "colour", e.desc);
            f.read("before", history.previous, &[(Part::ALL.of(1, 1), EXTENT, 0)], false)?;
            Ok(history.valid)
        })?;
        ensure!(valid, "the frame before wrote it");
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        // The writing pass is culled, as nothing needs its output, unless culling is off.
        let (_, executed) = rig.frame(EXTENT, |f| {
            let history = f.g.history(&e.scope, "colour", e.desc);
            let _ = f.g.pass("left_out", Queue::Graphics, |p| {
                p.sample(history.previous);
                (p.write(history.next).0, |_: &mut Record<'_>| {})
            });
            Ok(())
        })?;
        let culls = rig.executor.options().switches.cull;
        ensure!(executed.plan.order.is_empty() == culls, "{:?}", executed.plan.order);
        let (valid, _) = rig.frame(EXTENT, |f| Ok(f.g.history(&e.scope, "colour", e.desc).valid))?;
        ensure!(valid != culls, "valid is {valid}");
        rig.images(EXTENT, &mut [&mut e], &[false])
    })
}

#[test]
fn mistakes_name_the_history_and_leave_none_half_valid() -> Result<()> {
    under_all(|rig| {
        let (mut e, kept) = (full(Format::R32Float), HistoryScope::new());
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        rig.images(EXTENT, &mut [&mut e], &[true])?;
        let failed = rig.frame(Extent::new(40, 40), |f| {
            e.declare(f)?;
            f.g.history(&e.scope, "colour", e.desc);
            f.g.history_buffer(&kept, "reservoirs", BufferDesc::new(64));
            f.g.kept_buffer(&kept, "reservoirs", BufferDesc::new(64));
            Ok(())
        });
        let error = failed.err().and_then(|e| e.downcast::<ExecuteError>().ok()).map(|e| e.to_string());
        let error = error.unwrap_or_default();
        ensure!(error.contains("`colour` is declared twice"), "{error}");
        ensure!(error.contains("`reservoirs` is declared twice"), "{error}");
        rig.images(EXTENT, &mut [&mut e], &[false])?;
        rig.images(EXTENT, &mut [&mut e], &[true])?;
        // A frame that is declared, even in another size, and then discarded has no effect.
        let mut g = rig.executor.begin(Extent::new(5, 5));
        g.history(&e.scope, "colour", e.desc);
        drop(g);
        rig.images(EXTENT, &mut [&mut e], &[true])
    })
}

#[test]
fn memory_is_given_back() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut rig = Rig::new(&gpu, "")?;
    let scope = HistoryScope::new();
    let frame = |rig: &mut Rig, size: Extent| {
        rig.frame(size, |f| {
            let history = f.g.history(&scope, "large", ImageDesc::full(Format::Rgba32Float));
            let kept = f.g.kept_buffer(&scope, "words", BufferDesc::new(1 << 20));
            let (next, words) = f.g.pass("large.use", Queue::Graphics, |p| {
                p.sample(history.previous);
                ((p.write(history.next).0, p.write_buffer(kept.buffer).0), |_: &mut Record<'_>| {})
            });
            f.g.output(next.read());
            f.g.output(words.read());
            Ok(())
        })
    };
    rig.nothing()?;
    let (bytes, places) = gpu.in_use();
    let (small, large) = (Extent::new(128, 128), Extent::new(512, 256));
    let mut seen = Vec::new();
    for size in [large, small, large, large] {
        let (_, executed) = frame(&mut rig, size)?;
        let (now, taken) = gpu.in_use();
        let reported = executed.sample.memory.history_bytes;
        let least = 2 * 16 * u64::from(size.width * size.height) + (1 << 20);
        ensure!(reported >= least && reported < least + (1 << 16), "{reported} bytes of histories instead of {least}");
        ensure!(now - bytes == reported && taken - places == 4, "{now} bytes and {taken} places in use");
        seen.push(now);
    }
    ensure!(seen[0] == seen[2] && seen[2] == seen[3] && seen[1] < seen[0], "{seen:?}");
    rig.nothing()?;
    ensure!(gpu.in_use() == (bytes, places), "{:?} in use instead of {:?}", gpu.in_use(), (bytes, places));
    frame(&mut rig, large)?;
    rig.executor.restart();
    rig.nothing()?;
    ensure!(gpu.in_use() == (bytes, places), "after a restart: {:?}", gpu.in_use());
    Ok(())
}

/// Random sequences of events, against an independent statement of the rules: a history is valid if the newest frame that ran wrote it, in
/// this size, for this instance, and neither a cut nor a failed frame came after.
#[test]
fn anything_in_any_order() -> Result<()> {
    let seed = std::cell::Cell::new(0x2545_f491_4f6c_dd1d_u64);
    let random = |below: u64| {
        // Xorshift random numbers (Marsaglia 2003).
        let mut x = seed.get();
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        seed.set(x);
        (x >> 33) % below
    };
    under_all(|rig| {
        let sizes = [(1, 1), (2, 1), (21, 13), (22, 14), (5, 40)];
        let mut e = full(Format::Rg32Uint);
        let kept = HistoryScope::new();
        let (mut left, mut size, mut words, mut count) = (None, sizes[2], vec![0_u32; 8], 8_u32);
        let mut frames = [0, 0];
        for step in 0..150 {
            match random(12) {
                0 | 1 => size = sizes[random(5) as usize],
                2 => {
                    rig.executor.cut();
                    left = None;
                }
                3 => {
                    e.swap();
                    left = None;
                }
                4 => {
                    rig.nothing()?;
                    left = None;
                    words.fill(0);
                }
                5 => {
                    let failed = rig.frame(Extent::new(7, 7), |f| {
                        f.g.history(&e.scope, "colour", e.desc);
                        f.g.kept_buffer(&kept, "kept", BufferDesc::new(0));
                        Ok(())
                    });
                    ensure!(failed.is_err(), "step {step}: a kept buffer of no bytes");
                    left = None;
                }
                6 => count += random(10) as u32,
                _ => {
                    let extent = Extent::new(size.0, size.1);
                    let valid = left == Some(size);
                    let ((seen, (_, now)), _) =
                        rig.frame(extent, |f| Ok((e.declare(f)?, f.kept(&kept, count, count)?)))?;
                    e.check(&seen, valid).map_err(|e| e.context(format!("step {step}")))?;
                    words.resize(count as usize, 0);
                    words.iter_mut().zip(1..).for_each(|(word, more)| *word += more);
                    ensure!(words_of(&now, count) == words, "step {step}: the kept buffer");
                    left = Some(size);
                    frames[usize::from(valid)] += 1;
                }
            }
        }
        ensure!(frames[0] > 10 && frames[1] > 10, "{frames:?} frames were not valid and valid");
        Ok(())
    })
}
