use super::*;
use crate::slot::{ImplementationInfo, Preset, SettingSpec};

const PRESETS: [Preset; 2] = [
    Preset { name: "low", implementation: "shadow-map", settings: &[("size", "512")] },
    Preset { name: "high", implementation: "ray-traced", settings: &[("cone_degrees", "1")] },
];

fn implementation(name: &str, settings: Vec<SettingSpec>) -> ImplementationInfo {
    ImplementationInfo { name: name.to_owned(), about: "About.".to_owned(), settings }
}

fn catalogue() -> Catalogue {
    let cone = SettingSpec::float("cone_degrees", "degrees", "Higher is softer.", 0.27, 0.0..=10.0);
    let bias = SettingSpec::integer("size", "texels", "Higher is sharper.", 1024, 64..=4096);
    let curve = SettingSpec::choice("curve", "The curve.", "agx", &["agx", "aces", "none"]);
    Catalogue::new(vec![
        SlotInfo {
            name: "shadows".to_owned(),
            about: "Light that is blocked.".to_owned(),
            default: "ray-traced".to_owned(),
            implementations: vec![
                implementation("ray-traced", vec![cone]),
                implementation("shadow-map", vec![bias]),
                implementation("off", vec![]),
            ],
            presets: PRESETS.to_vec(),
        },
        SlotInfo {
            name: "post".to_owned(),
            about: "Tone map.".to_owned(),
            default: "tone-map".to_owned(),
            implementations: vec![implementation("tone-map", vec![curve])],
            presets: vec![],
        },
        SlotInfo {
            name: "gbuffer".to_owned(),
            about: "Surfaces.".to_owned(),
            default: "raster".to_owned(),
            implementations: vec![implementation("raster", vec![])],
            presets: vec![],
        },
    ])
}

fn fault(text: &str) -> String {
    match Config::from_toml(text, "f.toml") {
        Ok(config) => catalogue().check(&config, "f.toml").unwrap_err().to_string(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn later_layers_win_and_the_rest_stays() {
    let mut config = Config::from_toml("[stages]\nshadows = \"off\"\n[shadows]\ncone_degrees = 1.5\n", "a").unwrap();
    let over = Config::from_toml("[stages]\npost = \"tone-map\"\n[shadows]\nsize = 64\n", "b").unwrap();
    config.merge(over);
    config.set("stages.shadows = shadow-map").unwrap();
    config.set("shadows.cone_degrees=2").unwrap();
    assert_eq!(config.stages["shadows"], "shadow-map");
    assert_eq!(config.stages["post"], "tone-map");
    assert_eq!(config.settings["shadows"]["cone_degrees"], Value::Integer(2));
    assert_eq!(config.settings["shadows"]["size"], Value::Integer(64));
    catalogue().check(&config, "all").unwrap();
}

#[test]
fn complete_fills_in_the_chosen_implementations() {
    let mut config = Config::default();
    config.set("stages.shadows=shadow-map").unwrap();
    let full = catalogue().complete(&config);
    assert_eq!(full.stages.len(), 3);
    assert_eq!(full.settings["shadows"], BTreeMap::from([("size".to_owned(), Value::Integer(1024))]));
    assert_eq!(full.settings["post"]["curve"], Value::Text("agx".to_owned()));
    assert!(!full.settings.contains_key("gbuffer"));
    catalogue().check(&full, "all").unwrap();
}

#[test]
fn toml_and_json_read_back_the_same() {
    let mut config = catalogue().complete(&Config::default());
    config.set("shadows.cone_degrees=1e-7").unwrap();
    config.set("post.label=\"a \\ 'quoted'\"").unwrap();
    let text = config.to_toml().unwrap();
    assert_eq!(Config::from_toml(&text, "printed").unwrap(), config, "{text}");
    let json = serde_json::to_value(&config).unwrap();
    assert_eq!(json["stages"]["shadows"], "ray-traced");
    assert_eq!(json["shadows"]["cone_degrees"], 1e-7);
    assert_eq!(serde_json::from_value::<Config>(json).unwrap(), config);
}

#[test]
fn bad_toml_names_line_and_column() {
    let error = Config::from_toml("[stages]\nshadows = off\n", "f.toml").unwrap_err();
    assert!(matches!(error, ConfigError::Toml { line: 2, column: 11, .. }), "{error:?}");
    let error = Config::from_toml("[shadows]\ncone_degrees = 1\ncone_degrees = 2\n", "f.toml").unwrap_err();
    assert!(matches!(error, ConfigError::Toml { line: 3, column: 1, .. }), "{error:?}");
    assert!(error.to_string().contains("duplicate key"), "{error}");
    assert!(fault("[stages").starts_with("f.toml:1:"));
    assert!(fault(&"[".repeat(100_000)).starts_with("f.toml:1:"));
    assert!(fault(&format!("[a]\nx = {}", "[".repeat(100_000))).starts_with("f.toml:2:"));
}

#[test]
fn unknown_names_list_the_known_ones_and_the_closest() {
    let message = fault("[stages]\nshadow = \"off\"\n");
    assert!(message.contains("stages.shadow") && message.contains("did you mean \"shadows\"?"), "{message}");
    assert!(message.contains("known: shadows, post, gbuffer"), "{message}");
    let message = fault("[stages]\nshadows = \"shadowmap\"\n");
    assert!(message.contains("known: ray-traced, shadow-map, off"), "{message}");
    assert!(message.contains("did you mean \"shadow-map\"?"), "{message}");
    let message = fault("[shadows]\ncone_degree = 1\n");
    assert!(
        message.contains("shadows.cone_degree:") && message.contains("did you mean \"cone_degrees\"?"),
        "{message}"
    );
    assert!(message.contains("known: cone_degrees, size"), "{message}");
    let message = fault("[gbuffer]\nanything = 1\n");
    assert!(message.contains("no settings") && !message.contains("did you mean"), "{message}");
    assert!(fault("[weather]\nrain = true\n").contains("unknown stage \"weather\"; known"));
}

#[test]
fn unsuitable_values_are_refused() {
    for (text, wanted) in [
        ("[shadows]\ncone_degrees = 11", "shadows.cone_degrees: wanted 0 to 10, got 11"),
        ("[shadows]\ncone_degrees = -0.1", "wanted 0 to 10, got -0.1"),
        ("[shadows]\ncone_degrees = nan", "wanted a finite number, got NaN"),
        ("[shadows]\ncone_degrees = -inf", "wanted a finite number, got -inf"),
        ("[shadows]\ncone_degrees = \"wide\"", "wanted a number (0 to 10), got the text \"wide\""),
        ("[shadows]\nsize = 64.5", "wanted a whole number"),
        ("[shadows]\nsize = true", "wanted a whole number"),
        ("[shadows]\ncone_degrees = [1]", "got a value of type array"),
        ("[shadows]\ncone_degrees = 2020-01-01", "got a value of type datetime"),
        ("[shadows.deep]\nx = 1", "got a value of type table"),
        ("[stages]\nshadows = true", "wanted the name of an implementation"),
        ("[post]\ncurve = \"agz\"", "wanted one of agx, aces, none, got \"agz\" (did you mean \"agx\"?)"),
        ("shadows = \"off\"", "shadows: stands outside a table"),
        ("[shadows]\nsize = 99999999999999999999", "f.toml:2:"),
    ] {
        let message = fault(text);
        assert!(message.starts_with("f.toml:") && message.contains(wanted), "{text}: {message}");
    }
}

#[test]
fn a_setting_must_suit_the_chosen_implementation() {
    let mut catalogue = catalogue();
    let narrow = SettingSpec::float("cone_degrees", "degrees", "Higher is softer.", 0.1, 0.0..=0.5);
    catalogue.slots[0].implementations.push(implementation("sharp", vec![narrow]));
    let mut config = Config::default();
    config.set("shadows.cone_degrees=1").unwrap();
    catalogue.check(&config, "x").unwrap();
    config.set("stages.shadows=sharp").unwrap();
    let message = catalogue.check(&config, "x").unwrap_err().to_string();
    assert!(message.contains("wanted 0 to 0.5, got 1"), "{message}");
}

#[test]
fn assignments_have_one_form() {
    for bad in ["", "=", "shadows", "shadows=off", "stages.shadows", "stages.=off", ".x=1", "a.b.c=1", "a.b=", "a.b= "]
    {
        let error = Config::default().set(bad).unwrap_err();
        assert!(matches!(error, ConfigError::Assignment { .. }), "{bad}: {error}");
    }
    for bad in ["shadows.cone_degrees=nan", "shadows.cone_degrees=inf", "shadows.cone_degrees=1e999"] {
        let error = Config::default().set(bad).unwrap_err();
        assert!(matches!(error, ConfigError::NotFinite { .. }), "{bad}: {error}");
    }
    let mut config = Config::default();
    for good in ["a.bool=true", "a.whole=-3", "a.number=2.5", "a.text=x=y", "a.quoted=\"true\""] {
        config.set(good).unwrap();
    }
    let values: Vec<_> = config.settings["a"].values().cloned().collect();
    let text = |t: &str| Value::Text(t.to_owned());
    let wanted = vec![Value::Bool(true), Value::Float(2.5), text("true"), text("x=y"), Value::Integer(-3)];
    assert_eq!(values, wanted);
}

#[test]
fn edits_are_those_of_levenshtein() {
    for (a, b, wanted) in
        [("", "", 0), ("", "abc", 3), ("kitten", "sitting", 3), ("AgX", "agx", 0), ("flaw", "lawn", 2)]
    {
        assert_eq!(edits(a, b), wanted, "{a} {b}");
        assert_eq!(edits(b, a), wanted, "{b} {a}");
    }
}

#[test]
fn a_preset_stands_for_an_implementation_and_settings_and_what_is_given_wins() {
    let complete = |text: &str| {
        let config = Config::from_toml(text, "f.toml").unwrap();
        catalogue().check(&config, "f.toml").unwrap();
        catalogue().complete(&config)
    };
    let low = complete("[stages]\nshadows = \"low\"");
    assert_eq!(
        (low.stages["shadows"].as_str(), &low.settings["shadows"]["size"]),
        ("shadow-map", &Value::Integer(512))
    );
    let high = complete("[stages]\nshadows = \"high\"");
    assert_eq!(high.stages["shadows"], "ray-traced");
    assert_eq!(high.settings["shadows"]["cone_degrees"], Value::Float(1.0), "in the type of the setting");
    let own = complete("[stages]\nshadows = \"low\"\n[shadows]\nsize = 2048");
    assert_eq!(own.settings["shadows"]["size"], Value::Integer(2048));
    assert!(fault("[stages]\nshadows = \"low\"\n[shadows]\nsize = 1").contains("size"));
    assert!(
        fault("[stages]\nshadows = \"hihg\"").contains("did you mean \"high\""),
        "{}",
        fault("[stages]\nshadows = \"hihg\"")
    );
    assert!(fault("[stages]\npost = \"low\"").contains("unknown implementation"));
}
