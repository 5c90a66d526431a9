//! Commands, options and values are in the help, and invalid values are refused even if the command does not use them.

use crate::support::program::colvis;
use crate::support::run::run;

/// Each command with its options.
const COMMANDS: [(&str, &str); 20] = [
    ("", "--threads --wall --spacing --hu --series --allow-gaps --fov --camera --seed --cleanse"),
    (
        "fly",
        "--headless --guide --from --to --reverse --seconds --fps --size --quality --preset --record --log --stats \
         --coverage --record-input --replay --play --rate --scene --second --force --coverage-mesh --review \
         --answers",
    ),
    ("render", "--poses --out --size --quality --preset --samples --no-reuse --depth --normals --stats"),
    ("slice", "--at --plane --size --mm-per-pixel --level --window --slab --out"),
    ("segment", "--out --stats --labels --from --picture"),
    ("surface", "--mask --out --stats --from"),
    ("centerline", "--mask --out --method --from --to --stats"),
    ("phantom", "--out --truth --size --with --position --labels --twin --second --slice --noise --into --lesions"),
    ("archive", "--patient --date --description --max --series --out"),
    ("info", ""),
    ("explain", "--json --guide --from --scene --coverage"),
    ("plane", "--headless --out"),
    ("report", "--out --scan --quick --steps --truth"),
    ("cleanse", "--out --from --stats"),
    ("unfold", "--out --map --from --to --stats"),
    ("measure", "--at --out --from --stats"),
    ("candidates", "--out --gallery --max --detector --from --stats"),
    ("match", "--out --stats"),
    (
        "dataset",
        "--phantoms --out --layout --poses --path --deform --truth --size --mucosa --lights --shadows --exposure --gamma --noise --noise-seed --linear --guide --from --to --reverse --seconds --fps --replay --play --rate --scene \
         --stats",
    ),
    ("batch", "--out --do --shard --jobs --memory --timeout --group"),
];

/// Options with a fixed set of values.
const VALUES: [(&[&str], &str); 15] = [
    (&["archive"], "echo find get send"),
    (&["batch", "--do"], "segment centerline cleanse fly candidates coverage unfold surface case"),
    (&["fly", "--guide"], "tentacles potential path manual"),
    (&["fly", "--quality"], "high low adaptive reference"),
    (&["fly", "--preset"], "default colvis lean"),
    (&["fly", "--camera"], "perspective fisheye panorama"),
    (&["render", "--camera"], "perspective fisheye panorama"),
    (&["slice", "--plane"], "axial coronal sagittal"),
    (&["slice", "--slab"], "mean max min"),
    (&["segment", "--labels"], "other wall"),
    (&["centerline", "--method"], "penalised peel roadmap cells"),
    (&["phantom", "--size"], "small standard large"),
    (&["phantom", "--position"], "supine prone left right"),
    (
        &["phantom", "--with"],
        "folds polyps fluid bridges noise pools films stool inhomogeneous pseudo lesions decoys ileum stomach lungs collapsed pelvis touching",
    ),
    (&["report"], "render gradients scenes dynamics fields perforation cleansing coverage unfold candidates all"),
];

fn told(args: &[&str]) -> String {
    let out = run(args, 2);
    String::from_utf8_lossy(&out.stderr).into_owned()
}

fn help(command: &str) -> String {
    let args: Vec<&str> = command.split_whitespace().chain(["--help"]).collect();
    let out = colvis().args(&args).output().unwrap();
    assert!(out.status.success(), "{args:?}");
    String::from_utf8_lossy(&out.stdout).into_owned()
}

#[test]
fn commands_and_options_are_there() {
    for (command, options) in COMMANDS {
        let help = help(command);
        for option in options.split_whitespace() {
            let is_there = help.split([' ', ',', '\n']).any(|word| word == option);
            assert!(is_there, "{command} --help has no {option}");
        }
    }
}

#[test]
fn values_are_there() {
    for (option, values) in VALUES {
        let help = help(option[0]).to_lowercase();
        for value in values.split_whitespace() {
            assert!(help.contains(value), "{option:?}: {value}");
        }
        told(&[option, &["warp"]].concat());
    }
}

#[test]
fn a_scan_named_as_a_command_is_opened_by_its_path() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("slice"), "no scan").unwrap();
    for (args, status) in [
        (&["slice", "--headless"][..], 2),
        (&["./slice", "--headless"], 3),
        (&["fly", "slice", "--headless"], 3),
        (&["explain", "slice", "--headless"], 3),
    ] {
        let out = colvis().args(args).current_dir(dir.path()).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(status), "{args:?}: {said}");
    }
}

#[test]
fn values_without_sense_are_refused_by_every_command() {
    let commands: [&[&str]; 11] = [
        &["fly", "--headless"],
        &["explain", "--headless"],
        &["render", "none.nii", "--poses", "none.json", "--out", "none"],
        &["segment", "none.nii", "--out", "none.nii.gz"],
        &["surface", "none.nii", "--out", "none.stl"],
        &["centerline", "none.nii", "--out", "none.json"],
        &["phantom", "--out", "none.nii.gz"],
        &["info", "none.nii"],
        &["plane", "--headless", "--out", "none.png"],
        &["report", "fields", "--out", "none"],
        &["slice", "none.nii", "--at=1,2,3", "--plane=axial", "--out", "none.png"],
    ];
    for command in commands {
        for wrong in [
            "--fov=400",
            "--fov=0",
            "--fov=-5",
            "--fov=nan",
            "--fov=x",
            "--wall=-500,-800",
            "--wall=0",
            "--wall=nan,0",
            "--wall=0,1e9",
            "--spacing=1,1,0",
            "--spacing=1,1",
            "--spacing=1,1,-1",
            "--spacing=1,1,1e30",
            "--hu=5,5",
            "--hu=0,1e9",
            "--hu=x,1",
            "--threads=0",
            "--threads=1e9",
            "--series=0",
            "--seed=-1",
            "--camera=warp",
        ] {
            assert!(told(&[command, &[wrong]].concat()).contains("error: "), "{command:?} {wrong}");
        }
    }
    let pictures = ["--size=0x4", "--size=4", "--size=99999x9"];
    let flight = ["--seconds=0", "--seconds=nan", "--fps=0", "--fps=1e9", "--fps=-1", "--rate=2"];
    for (command, wrong) in [
        (&["fly", "--headless"][..], &[&pictures[..], &flight].concat()[..]),
        (&["explain"], &[&pictures[..], &flight].concat()),
        (commands[2], &[&pictures[..], &["--samples=0", "--quality=x"]].concat()),
        (commands[9], &["--steps=0", "--steps=x"]),
        (commands[6], &["--size=tiny", "--with=warp"]),
        (commands[5], &["--method=warp", "--from=1,2", "--to=1,2,nan"]),
        (commands[10], &pictures),
        (commands[10], &["--mm-per-pixel=0", "--mm-per-pixel=-1", "--mm-per-pixel=nan", "--mm-per-pixel=1e300"]),
        (
            commands[10],
            &["--level=nan", "--level=inf", "--window=0", "--window=-400", "--window=nan", "--window=1e999"],
        ),
        (
            commands[10],
            &["--slab=5", "--slab=-1,mean", "--slab=20.5,max", "--slab=nan,min", "--slab=5,median", "--slab="],
        ),
        (commands[3], &["--labels=gas", "--from=rectum", "--labels"]),
    ] {
        for w in wrong {
            told(&[command, &[*w]].concat());
        }
    }
}
