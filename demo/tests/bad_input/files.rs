//! Files that are no files, and a folder that somebody else writes to.
use super::*;

/// What is no regular file may never come or never end: it is not even opened.
#[cfg(unix)]
#[test]
fn pipes_and_devices() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for pipe in ["p.gltf", "p.glb", "p.toml", "p.hdr", "p.exr", "p.bin", "p.png"] {
        assert!(Command::new("mkfifo").arg(at(pipe)).status().unwrap().success());
    }
    let (mut scene, _) = triangle();
    scene["buffers"][0]["uri"] = json!("p.bin");
    fs::write(at("buffer.gltf"), scene.to_string()).unwrap();
    let (mut scene, bytes) = triangle();
    scene["buffers"][0].as_object_mut().unwrap().remove("uri");
    scene["images"] = json!([{"uri": "p.png"}]);
    scene["textures"] = json!([{"source": 0}]);
    scene["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    scene["meshes"][0]["primitives"][0]["material"] = json!(0);
    fs::write(at("image.glb"), container(&scene.to_string(), &bytes)).unwrap();
    let pipe = "wanted a regular file, this is a named pipe";
    let cases: &[(&[&str], &[&str])] = &[
        (&["render", "p.gltf"], &["p.gltf", pipe]),
        (&["render", "p.glb"], &["p.glb", pipe]),
        (&["render", "buffer.gltf"], &["buffer 0", "p.bin", pipe]),
        (&["render", "image.glb"], &["image 0", "p.png", pipe]),
        (&["render", "builtin:cornell", "--config", "p.toml"], &["p.toml", pipe]),
        (&["render", "builtin:cornell", "--camera", "p.toml"], &["--camera", "p.toml", pipe]),
        (&["render", "builtin:cornell", "--environment", "p.hdr"], &["--environment", "p.hdr", pipe]),
        (&["render", "builtin:cornell", "--environment", "p.exr"], &["--environment", "p.exr", pipe]),
        (&["render", "/dev/zero"], &["/dev/zero", "this is a device"]),
        (&["render", "builtin:cornell", "--config", "/dev/zero"], &["/dev/zero", "this is a device"]),
        (&["render", "builtin:cornell", "--config", "."], &["this is a folder"]),
        (
            &["reference", "builtin:cornell", "--samples", "1", "--out", "o.exr", "--merge", "p.exr"],
            &["--merge", "p.exr", pipe],
        ),
        (
            &["reference", "builtin:cornell", "--samples", "1", "--out", "p.exr"],
            &["--out", "p.exr", "wanted a regular file"],
        ),
        (&["accuracy", "p.glb", "--out", "report"], &["p.glb", pipe]),
        (&["compare", "p.png", "p.png"], &["p.png", "wanted a file"]),
    ];
    for (arguments, names) in cases {
        refused(folder.path(), arguments, 2, names);
    }
}

/// One run at a time writes to the folder of a report, and the second is told who does.
#[test]
fn a_folder_in_use() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("report")).unwrap();
    let holder = "`magpie accuracy builtin:courtyard` (process 1234)";
    fs::write(folder.path().join("report/magpie.lock"), holder).unwrap();
    let lock = fs::File::open(folder.path().join("report/magpie.lock")).unwrap();
    lock.lock().unwrap();
    let names = ["--out report", holder, "is writing to this folder"];
    refused(folder.path(), &["accuracy", "builtin:cornell", "--quick", "--out", "report"], 2, &names);
    refused(folder.path(), &["accuracy", "merge", "a", "b", "--out", "report"], 2, &names);
    lock.unlock().unwrap();
    // Now it is only the device that is missing.
    let ended = run(folder.path(), &["accuracy", "builtin:cornell", "--quick", "--out", "report"].map(OsString::from));
    assert_eq!(ended.status, Some(3), "{}", ended.stderr);
}
