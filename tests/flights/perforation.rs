//! Twenty thousand random steps against walls of every kind. `colvis report perforation` takes a million.

use colvis::progress::Progress;
use colvis::report::perforation::run;

#[test]
#[ignore = "slow: twenty thousand random steps"]
fn twenty_thousand_steps_never_perforate() {
    let outcome = run(20_000, 1, &Progress::new()).unwrap();
    println!("{:?}", outcome.all);
    for (name, t) in
        outcome.places.iter().map(|(n, t)| (n.as_str(), t)).chain(outcome.methods.iter().map(|(n, t)| (*n, t)))
    {
        assert_eq!((t.perforations, t.broken, t.hangs), (0, 0, 0), "{name}: {t:?}");
    }
    let all = outcome.all;
    assert_eq!(all.steps, 20_000);
    // The steps were difficult.
    assert!(all.blocked > 4000 && all.too_near > 2000 && all.stuck > 1900, "{all:?}");
    assert!(all.margin_mm >= 0.0 && all.margin_mm < 0.11, "the wall was touched: {all:?}");
}

#[test]
#[ignore = "slow: random steps in every volume of the report, twice"]
fn the_same_for_any_number_of_threads() {
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(1500, 7, &Progress::new()).unwrap())
    };
    assert_eq!(with(1), with(2));
}
