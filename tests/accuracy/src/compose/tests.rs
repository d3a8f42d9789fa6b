use super::*;

fn grey(of: impl Fn(usize) -> f32) -> Picture {
    Picture::grey(8, 4, &(0..32).map(of).collect::<Vec<_>>())
}

fn sum(terms: &[Picture; 4]) -> Picture {
    let mut all = terms[0].clone();
    for term in &terms[1..] {
        all.pixels.iter_mut().zip(&term.pixels).for_each(|(a, t)| (0..3).for_each(|c| a[c] += t[c]));
    }
    all
}

/// The terms of a frame: lights times shadows, sky light times ambient occlusion.
fn frame(shadows: f32, ao: f32, gi: f32) -> [Picture; 4] {
    let seen = |i: usize| if i.is_multiple_of(3) { 1.0 - 0.8 * shadows } else { 1.0 };
    let open = |i: usize| 1.0 - ao * 0.02 * i as f32;
    [
        grey(|i| 0.7 * seen(i)),
        grey(|i| gi * 0.3 * open(i)),
        grey(|i| 0.05 * open(i)),
        grey(|i| if i < 8 { 0.9 } else { 0.0 }),
    ]
}

fn parts(of: [Picture; 4], default: &[Picture; 4]) -> Parts {
    let mut terms = of.map(Some);
    terms.iter_mut().zip(default).for_each(|(t, d)| {
        t.take_if(|t| t == d);
    });
    Parts { terms, whole: None }
}

fn composer(parts: BTreeMap<String, Parts>) -> Composer {
    let default = frame(1.0, 1.0, 1.0);
    Composer::new(sum(&default), Display::PLAIN, sum(&default), Some(default), parts)
}

fn near(a: &Picture, b: &Picture) {
    for (at, (a, b)) in a.pixels.iter().zip(&b.pixels).enumerate() {
        assert!((a[1] - b[1]).abs() < 1e-5, "pixel {at}: {} {}", a[1], b[1]);
    }
}

#[test]
fn choices_of_a_frame_compose_as_the_frame_does() {
    let default = frame(1.0, 1.0, 1.0);
    let made = |shadows, ao, gi| parts(frame(shadows, ao, gi), &default);
    let parts = [("shadows", made(0.0, 1.0, 1.0)), ("ao", made(1.0, 0.0, 1.0)), ("gi", made(1.0, 1.0, 0.0))];
    let composer = composer(parts.map(|(id, parts)| (id.to_owned(), parts)).into());
    near(&composer.compose([]), &sum(&default));
    near(&composer.compose(["shadows"]), &sum(&frame(0.0, 1.0, 1.0)));
    near(&composer.compose(["shadows", "ao"]), &sum(&frame(0.0, 0.0, 1.0)));
    // Without sky light ambient occlusion has no effect; adding the two changes would predict one.
    near(&composer.compose(["ao", "gi"]), &sum(&frame(1.0, 0.0, 0.0)));
    near(&composer.compose(["shadows", "ao", "gi"]), &sum(&frame(0.0, 0.0, 0.0)));
    let added: f32 =
        ["ao", "gi"].iter().map(|id| composer.compose([*id]).pixels[31][1] - sum(&default).pixels[31][1]).sum();
    assert!((sum(&default).pixels[31][1] + added - sum(&frame(1.0, 0.0, 0.0)).pixels[31][1]).abs() > 0.1);
    assert_eq!(composer.error(Metric::FlipLdr, []), Ok(0.0));
    assert!(composer.error(Metric::FlipLdr, ["gi"]).unwrap() > 0.01);
}

#[test]
fn what_a_whole_picture_goes_through_is_laid_over_the_sum() {
    let default = frame(1.0, 1.0, 1.0);
    let smooth = |p: &Picture| {
        let at = |i: usize| p.pixels[i][1];
        grey(|i| (at(i.saturating_sub(1)) + 2.0 * at(i) + at((i + 1).min(31))) / 4.0)
    };
    let whole = Parts { whole: Some(smooth(&sum(&default))), ..Parts::default() };
    let parts = [("taa".to_owned(), whole), ("gi".to_owned(), parts(frame(1.0, 1.0, 0.0), &default))];
    let composer = composer(parts.into());
    near(&composer.compose(["taa"]), &smooth(&sum(&default)));
    // Close to the rendered picture, and closer than without either change.
    let wanted = smooth(&sum(&frame(1.0, 1.0, 0.0)));
    let off = |p: &Picture| crate::metrics::rmse(p, &wanted).unwrap();
    let both = off(&composer.compose(["taa", "gi"]));
    assert!(both < 0.3 * off(&composer.compose(["taa"])), "{both}");
    assert!(both < 0.5 * off(&composer.compose(["gi"])), "{both} {}", off(&composer.compose(["gi"])));
}

#[test]
fn a_picture_is_split_into_its_terms_and_comes_back_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let (default, other) = (frame(1.0, 1.0, 1.0), frame(0.0, 1.0, 1.0));
    let terms = |of: &[Picture; 4]| TERMS.iter().zip(of).map(|(n, p)| ((*n).to_owned(), p.clone())).collect();
    let apart = split(&sum(&default), &terms(&default)).unwrap();
    near(&apart[3], &default[3]);
    assert!(split(&smaller(&sum(&default), 2), &terms(&default)).is_none(), "of another size");

    write_terms(folder.path(), "d", &apart, None).unwrap();
    let other = split(&sum(&other), &terms(&other)).unwrap();
    write_terms(folder.path(), "s", &other, Some(&apart)).unwrap();
    assert!(folder.path().join("s.term.direct.exr").exists() && !folder.path().join("s.term.gi.exr").exists());
    assert_eq!(read_terms(folder.path(), "d").unwrap(), apart);

    let read = || Composer::read(folder.path(), Display::PLAIN, "d", [("s", false)].into_iter()).unwrap();
    write_exr(&folder.path().join("truth.all.exr"), &sum(&default)).unwrap();
    assert!(read().is_none(), "no picture of the default");
    write_exr(&folder.path().join("d.exr"), &sum(&default)).unwrap();
    write_exr(&folder.path().join("s.exr"), &sum(&frame(0.0, 1.0, 1.0))).unwrap();
    let composer = read().unwrap();
    near(&composer.compose(["s"]), &sum(&frame(0.0, 1.0, 1.0)));
    assert!(composer.knows("s", "d") && composer.knows("d", "d") && !composer.knows("x", "d"));
    let small = composer.at_most(4);
    assert_eq!((small.truth().width, small.compose(["s"]).height), (4, 2));
}
