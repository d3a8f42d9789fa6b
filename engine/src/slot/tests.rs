use super::*;
use crate::config::{Catalogue, Config};

fn cone() -> SettingSpec {
    SettingSpec::float("cone_degrees", "degrees", "Higher is softer.", 0.27, 0.0..=10.0)
}

fn implementation() -> ImplementationInfo {
    let settings = vec![
        cone(),
        SettingSpec::integer("rays", "rays per pixel", "More is smoother.", 1, 1..=64),
        SettingSpec::switch("jitter", "Moves the samples.", true),
        SettingSpec::choice("curve", "Shape.", "agx", &["agx", "aces", "none"]),
    ];
    ImplementationInfo { name: "ray-traced".to_owned(), about: String::new(), settings }
}

#[test]
fn settings_fill_in_defaults_and_keep_the_described_types() {
    let given =
        BTreeMap::from([("cone_degrees".to_owned(), Value::Integer(2)), ("of_another".to_owned(), Value::Bool(true))]);
    let settings = Settings::new("shadows", &implementation(), &given).unwrap();
    assert_eq!(settings.f32("cone_degrees").unwrap(), 2.0);
    assert_eq!(settings.u32("rays").unwrap(), 1);
    assert!(settings.switch("jitter").unwrap());
    assert_eq!(settings.choice("curve").unwrap(), "agx");
    assert_eq!(settings.values().len(), 4);
}

#[test]
fn a_getter_of_the_wrong_type_says_what_was_registered() {
    let settings = Settings::new("shadows", &implementation(), &BTreeMap::new()).unwrap();
    let message = settings.f32("rays").unwrap_err().to_string();
    assert!(message.contains("shadows.rays") && message.contains("whole number"), "{message}");
    assert!(settings.choice("missing").unwrap_err().to_string().contains("not described"));
}

#[test]
fn unsuitable_values_name_range_and_value() {
    for (value, wanted) in [
        (Value::Float(10.5), "wanted 0 to 10, got 10.5"),
        (Value::Float(f64::NAN), "finite"),
        (Value::Float(f64::INFINITY), "finite"),
        (Value::Text("wide".to_owned()), "wanted a number (0 to 10), got the text \"wide\""),
    ] {
        let message = cone().accept(&value).unwrap_err().to_string();
        assert!(message.contains(wanted), "{message}");
    }
    assert!(cone().accept(&Value::Float(10.0)).is_ok());
    assert!(cone().accept(&Value::Float(0.0)).is_ok());
}

#[test]
fn numbers_of_a_list_are_accepted_and_no_others() {
    let spec = SettingSpec::among("precision", "bits", "More is more exact.", 32, &[32, 16]).sweep_all();
    assert_eq!(spec.accept(&Value::Integer(16)), Ok(Value::Integer(16)));
    let message = spec.accept(&Value::Integer(17)).unwrap_err().to_string();
    assert_eq!(message, "wanted one of 32, 16, got 17");
    assert_eq!(spec.sweep, [Value::Integer(32), Value::Integer(16)]);
}

#[test]
fn sweeps_hold_the_default_and_what_the_range_accepts() {
    assert!(cone().sweep.is_empty(), "nobody said that it trades accuracy for time");
    assert_eq!(cone().sweep([1.0, 2.0]).sweep, [0.27, 1.0, 2.0].map(Value::Float));
    let all = |spec: SettingSpec| spec.sweep_all().sweep;
    assert_eq!(all(SettingSpec::switch("jitter", "Moves.", true)), [true, false].map(Value::Bool));
    assert_eq!(all(SettingSpec::choice("curve", "Shape.", "b", &["a", "b"])), ["a", "b"].map(Value::from));
    for bad in [cone().sweep([11.0]), cone().sweep([1.0, 1.0]), cone().sweep([Value::Integer(1)])] {
        assert_eq!(bad.mistakes_of_sweep().len(), 1, "{bad:?}");
    }
}

#[test]
fn a_description_that_contradicts_itself_is_found() {
    let bad = SettingSpec::float("cone_degrees", "degrees", "", 11.0, 0.0..=10.0);
    let info = SlotInfo {
        name: "shadows".to_owned(),
        about: String::new(),
        default: "gone".to_owned(),
        implementations: vec![ImplementationInfo { settings: vec![bad, cone()], ..implementation() }],
        presets: vec![],
    };
    assert_eq!(info.mistakes().len(), 4, "{:?}", info.mistakes());
    let preset = |name, implementation, settings| Preset { name, implementation, settings };
    let good = SlotInfo {
        default: "ray-traced".to_owned(),
        implementations: vec![implementation()],
        presets: vec![preset("high", "ray-traced", &[("cone_degrees", "1")])],
        ..info
    };
    let presets = vec![
        preset("best", "ray-traced", &[]),
        preset("low", "gone", &[]),
        preset("high", "ray-traced", &[("cone_degrees", "11"), ("cone", "1")]),
        preset("ray-traced", "ray-traced", &[]),
    ];
    let bad = SlotInfo { presets, ..good.clone() };
    assert_eq!(bad.mistakes().len(), 6, "{:?}", bad.mistakes());
    assert!(good.mistakes().is_empty());
}

/// Stages of plain numbers, to be wrapped.
fn numbers() -> Slot<u32, u32> {
    let settings = [cone(), SettingSpec::integer("rays", "rays per pixel", "More is smoother.", 1, 1..=64)];
    Slot::new("shadows").with("plain", "Plain.", &settings, |_, _| Err(SlotError::other("not made here")))
}

#[test]
fn a_wrapper_has_the_settings_of_what_it_wraps() {
    let mut stage = numbers();
    let own = SettingSpec::switch("tinted", "Colours.", false).sweep_all();
    stage.wrap("plain", "outer", "Around.", &[own], |_, _, inner| Ok(inner)).unwrap();
    let keys: Vec<_> = stage.info().implementation("outer").unwrap().settings.iter().map(|s| s.key).collect();
    assert_eq!(keys, ["tinted", "cone_degrees", "rays"]);
    assert_eq!(stage.info().implementation("plain").unwrap().settings.len(), 2);
    assert!(stage.info().mistakes().is_empty(), "{:?}", stage.info().mistakes());

    let given =
        Config::from_toml("[stages]\nshadows = \"outer\"\n[shadows]\nrays = 7\ntinted = true\n", "test").unwrap();
    Catalogue::new(vec![stage.info().clone()]).check(&given, "test").unwrap();
    let settings = stage.wanted(&given).unwrap().1;
    assert_eq!((settings.u32("rays").unwrap(), settings.switch("tinted").unwrap()), (7, true));
    let inner = settings.of(stage.info().implementation("plain").unwrap());
    assert_eq!(inner.values().len(), 2);
    assert_eq!((inner.u32("rays").unwrap(), inner.f32("cone_degrees").unwrap()), (7, 0.27));
    assert!(inner.switch("tinted").is_err(), "the wrapper's own setting is none of the wrapped one's");
    let wrong = Config::from_toml("[stages]\nshadows = \"outer\"\n[shadows]\nrays = 65\n", "test").unwrap();
    assert!(
        stage.wanted(&wrong).unwrap_err().to_string().contains("shadows.rays: wanted"),
        "out of the wrapped one's range"
    );
}

#[test]
fn a_wrapper_of_nothing_and_a_setting_twice_are_refused() {
    let mut stage = numbers();
    let message = stage.wrap("plane", "outer", "", &[], |_, _, inner| Ok(inner)).unwrap_err().to_string();
    assert!(message.contains("\"plane\"") && message.contains("known: plain"), "{message}");
    let message = stage.wrap("plain", "outer", "", &[cone()], |_, _, inner| Ok(inner)).unwrap_err().to_string();
    assert!(message.starts_with("shadows.cone_degrees: \"outer\" would have it twice"), "{message}");
    assert_eq!(stage.info().names(), ["plain"], "nothing was registered");
}

#[test]
fn an_implementation_can_be_wrapped_under_its_own_name() {
    let mut stage = numbers();
    for _ in 0..2 {
        stage.wrap("plain", "plain", "Around.", &[], |_, _, inner| Ok(inner)).unwrap();
    }
    assert_eq!(stage.info().names(), ["plain"]);
    assert_eq!(stage.info().implementation("plain").unwrap().about, "Around.");
    assert_eq!(stage.info().implementation("plain").unwrap().settings.len(), 2);
}

/// An effect that asks for something.
struct WithNeeds(Needs);

impl Effect for WithNeeds {
    type In = u32;
    type Out = u32;

    fn needs(&self, _: &SceneFacts) -> Needs {
        self.0.clone()
    }

    fn add(&mut self, _: &mut FrameGraph, _: &View, input: u32) -> u32 {
        input
    }
}

/// An effect that says nothing of what it needs.
struct WithoutNeeds;

impl Effect for WithoutNeeds {
    type In = u32;
    type Out = u32;

    fn add(&mut self, _: &mut FrameGraph, _: &View, input: u32) -> u32 {
        input
    }
}

#[test]
fn a_wrapper_asks_for_what_it_wraps_asks_for() {
    let part = |name| Part { name, idle: None, without: None };
    let inner = Needs { jitter: true, resolution_scale: 0.5, ..Needs::default() }.part(part("a"));
    let outer = Needs { emitters: true, resolution_scale: 0.75, ..Needs::default() }.part(part("a")).part(part("b"));
    let needs_of = |outer: Option<Needs>| {
        let inner = inner.clone();
        let mut slot = Slot::new("shadows")
            .with("plain", "Plain.", &[], move |_, _| Ok(Box::new(WithNeeds(inner.clone())) as BoxedEffect<u32, u32>));
        slot.wrap("plain", "outer", "Around.", &[], move |_, _, _| {
            Ok(outer
                .clone()
                .map_or_else(|| Box::new(WithoutNeeds) as BoxedEffect<u32, u32>, |needs| Box::new(WithNeeds(needs))))
        })
        .unwrap();
        let pipelines = crate::gpu::Pipelines::default();
        let build = Build::without_device(&pipelines, magpie_shaders::Rays::Software);
        slot.choose(&build, "outer", &BTreeMap::new()).unwrap().needs(&SceneFacts::default())
    };
    assert_eq!(needs_of(None), inner);
    let both = needs_of(Some(outer));
    assert_eq!((both.jitter, both.emitters, both.resolution_scale), (true, true, 0.5));
    assert_eq!(both.parts, [part("a"), part("b")]);
    assert_eq!(needs_of(Some(Needs::idle("why"))).idle.as_deref(), Some("why"));
}

#[test]
fn without_a_device_pipelines_are_described_and_none_is_made() {
    let pipelines = crate::gpu::Pipelines::default();
    let build = Build::without_device(&pipelines, magpie_shaders::Rays::Pipeline);
    let kernel = build.kernel(&magpie_shaders::POST_TONE_MAP_COMP).unwrap();
    assert_eq!(kernel, build.kernel(&magpie_shaders::POST_TONE_MAP_COMP).unwrap(), "the same description");
    assert_ne!(kernel, build.kernel(&magpie_shaders::POST_TAA_COMP).unwrap());
    build.ray_kernel(&magpie_shaders::AO_TRACE_RAY).unwrap();
    assert_eq!(pipelines.made(), [""; 0]);
    assert!(matches!(build.gpu(), Err(SlotError::NoDevice)));
}
