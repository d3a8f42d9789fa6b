//! Plans of random frames against a slow checker that shares no code with the planner, and the checker against plans with a
//! mistake planted in them. No GPU. `PROPTEST_CASES` sets the number of frames.

#[path = "plan/checker.rs"]
mod checker;
#[path = "plan/mistakes.rs"]
mod mistakes;
#[path = "plan/random.rs"]
mod random;

use magpie::graph::{dump, plan};
use proptest::prelude::*;

use checker::check;
use mistakes::MISTAKES;
use random::{Script, scripts};

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn plans_of_random_frames_are_sound(script in scripts()) {
        let frame = script.declare().finish().unwrap();
        let plan = plan(&frame.declaration);
        if let Err(complaint) = check(&frame.declaration, &plan) {
            return Err(TestCaseError::fail(format!("{complaint}\n{}", dump::text(&frame.declaration, &plan))));
        }
    }

    #[test]
    fn the_checker_finds_planted_mistakes(script in scripts(), pick in any::<usize>()) {
        let frame = script.declare().finish().unwrap();
        let good = plan(&frame.declaration);
        for (name, plant) in MISTAKES {
            let mut bad = good.clone();
            if plant(&frame.declaration, &mut bad, pick) && check(&frame.declaration, &bad).is_ok() {
                let text = dump::text(&frame.declaration, &bad);
                return Err(TestCaseError::fail(format!("the checker overlooks this mistake: {name}\n{text}")));
            }
        }
    }

    #[test]
    fn planning_and_dumping_are_functions(script in scripts()) {
        let (a, b) = (script.declare().finish().unwrap(), script.declare().finish().unwrap());
        prop_assert_eq!(&a.declaration, &b.declaration);
        let (plan_a, plan_b) = (plan(&a.declaration), plan(&b.declaration));
        prop_assert_eq!(&plan_a, &plan_b);
        prop_assert_eq!(dump::text(&a.declaration, &plan_a), dump::text(&b.declaration, &plan_b));
        prop_assert_eq!(dump::dot(&a.declaration, &plan_a), dump::dot(&b.declaration, &plan_b));
        prop_assert_eq!(dump::json(&a.declaration, &plan_a), dump::json(&b.declaration, &plan_b));
    }
}

/// Each mistake can be planted in a frame made by hand, so that the property above is not true for want of cases.
#[test]
fn every_mistake_can_be_made_and_is_found() {
    let frame = mistakes::frame().finish().unwrap();
    let good = plan(&frame.declaration);
    assert_eq!(check(&frame.declaration, &good), Ok(()));
    for (name, plant) in MISTAKES {
        for pick in 0..20 {
            let mut bad = good.clone();
            assert!(plant(&frame.declaration, &mut bad, pick), "{name} cannot be planted (pick {pick})");
            assert!(check(&frame.declaration, &bad).is_err(), "{name} is overlooked (pick {pick})");
        }
    }
}

/// Random frames are worth something: over many, most kinds of thing occur.
#[test]
fn random_frames_are_not_trivial() {
    use proptest::{strategy::ValueTree, test_runner::TestRunner};
    let mut runner = TestRunner::deterministic();
    let (mut kept, mut culled, mut barriers, mut weak, mut several) = (0, 0, 0, 0, 0);
    for _ in 0..200 {
        let script: Script = scripts().new_tree(&mut runner).unwrap().current();
        let frame = script.declare().finish().unwrap();
        let plan = plan(&frame.declaration);
        kept += plan.order.len();
        culled += plan.culled.len();
        barriers += plan.barriers.iter().map(Vec::len).sum::<usize>();
        weak += plan.order.iter().filter(|&&p| frame.declaration.passes[p as usize].weak).count();
        several += plan.barriers.iter().flatten().filter(|b| b.from.iter().count() > 1).count();
    }
    assert!(kept > 400 && culled > 200 && barriers > 1000, "{kept} kept, {culled} culled, {barriers} barriers");
    assert!(weak > 50 && several > 20, "{weak} weak passes kept, {several} barriers from several uses");
}
