//! Plug-ins: values that add systems, components and resources to a flight.

use std::any::type_name;
use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

use super::App;
use super::app::Owner;
use crate::error::{Error, Result};
use crate::panics::ask_plugin;
use crate::render::Options;

/// An extension of a flight from another crate: systems, entities, resources. It is a value, so it can carry settings and state.
///
/// A plug-in is built once per flight, before the scene's own systems. Its additions stay for the whole flight, through
/// every change of guide, direction and segment. `examples/own_plugin.rs` is a complete example.
///
/// A closure is a plug-in, and a pair of a name and a closure is a plug-in with that name: `app::Scene::plug` has an example.
pub trait Plugin: Send + Sync + 'static {
    /// Returns the name: used in `explain`, in messages, and as the name of its table in scene files.
    ///
    /// Two plug-ins in one flight cannot share a name.
    fn name(&self) -> Cow<'static, str> {
        short_type_name(type_name::<Self>()).into()
    }

    /// Returns the plug-in with the settings from its table in a scene file, or `None` to keep the plug-in unchanged.
    ///
    /// A plug-in with settings reads them with [`Options::read`]; the others refuse any.
    ///
    /// # Errors
    /// Returns status 2 if a setting does not exist or is out of range.
    fn with_options(&self, options: Options) -> Result<Option<Arc<dyn Plugin>>> {
        options.none().map(|()| None)
    }

    /// Returns what goes into the statistics of a flight (`fly --stats`) under `plugins` and the plug-in's name, or `None`.
    ///
    /// Asked once, after the flight, headless and in a window, if statistics are written. Keys are sorted, and numbers that are not
    /// finite become `null`. `examples/own_stats.rs` is a complete example.
    fn stats(&self, app: &App) -> Option<serde_json::Value> {
        let _ = app;
        None
    }

    /// Adds the plug-in's parts to the flight.
    ///
    /// The scan and the camera exist, but the camera has a pose only once the flight sets out.
    ///
    /// # Errors
    /// May return any error; the flight is then not created.
    fn build(&self, app: &mut App) -> Result<()>;
}

impl App {
    /// Builds a plug-in. Its additions stay when the scene changes.
    ///
    /// # Errors
    /// Returns the error of the plug-in, and status 2 if a plug-in of that name already exists.
    #[doc(hidden)]
    pub fn plug(&mut self, plugin: &dyn Plugin) -> Result<()> {
        let name = plugin.name().into_owned();
        if self.plugged.contains(&name) {
            let why = "is plugged in already";
            return Err(Error::usage(format!("plug-in {name:?}"), why, "give one of the two another name"));
        }
        self.plugged.push(name.clone());
        let owner = std::mem::replace(&mut self.owner, Owner::Plugin);
        let built = self.on_account(&name, |app| plugin.build(app));
        self.owner = owner;
        built
    }
}

impl<F> Plugin for F
where
    F: Fn(&mut App) -> Result<()> + Send + Sync + 'static,
{
    fn build(&self, app: &mut App) -> Result<()> {
        self(app)
    }
}

impl<F> Plugin for (&'static str, F)
where
    F: Fn(&mut App) -> Result<()> + Send + Sync + 'static,
{
    fn name(&self) -> Cow<'static, str> {
        self.0.into()
    }

    fn build(&self, app: &mut App) -> Result<()> {
        self.1(app)
    }
}

/// Returns a type's name without its modules; for a closure, the function that contains it.
fn short_type_name(name: &'static str) -> &'static str {
    let name = name.split('<').next().unwrap_or(name).trim_end_matches("::{{closure}}");
    name.rsplit("::").next().unwrap_or(name)
}

/// The plug-ins of a scene, in the order in which they were added.
#[derive(Clone, Default)]
pub struct Plugins(Vec<Arc<dyn Plugin>>);

impl Plugins {
    /// Adds a plug-in.
    ///
    /// # Errors
    /// Returns status 2 if a plug-in of that name already exists.
    pub fn add(&mut self, plugin: impl Plugin) -> Result<()> {
        let name = plugin.name();
        if self.iter().any(|p| p.name() == name) {
            let why = "two plug-ins have this name";
            return Err(Error::usage(format!("plug-in {name:?}"), why, "give one of them another name"));
        }
        self.0.push(Arc::new(plugin));
        Ok(())
    }

    /// Adds a plug-in regardless of its name. A flight refuses to build two plug-ins of the same name.
    pub fn push(&mut self, plugin: impl Plugin) {
        self.0.push(Arc::new(plugin));
    }

    /// Iterates over all plug-ins.
    pub fn iter(&self) -> impl Iterator<Item = &dyn Plugin> {
        self.0.iter().map(|p| &**p)
    }

    /// Passes the settings of a scene file to a plug-in. Returns false if there is no plug-in of that name.
    ///
    /// # Errors
    /// Returns the errors of [`Plugin::with_options`].
    pub fn configure(&mut self, name: &str, options: Options) -> Result<bool> {
        let Some(plugin) = self.0.iter_mut().find(|p| p.name() == name) else { return Ok(false) };
        let configured =
            ask_plugin(|| format!("plug-in {name}"), || plugin.with_options(options)).map_err(|e| in_table(name, e))?;
        if let Some(configured) = configured {
            *plugin = configured;
        }
        Ok(true)
    }

    /// Returns true if there are no plug-ins.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Names the table of settings in an error.
fn in_table(name: &str, e: Error) -> Error {
    e.named(|what| if what.contains(name) { what.to_owned() } else { format!("[{name}] {what}") })
}

impl fmt::Debug for Plugins {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter().map(|p| p.name())).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Rear;

    impl Plugin for Rear {
        fn build(&self, _: &mut App) -> Result<()> {
            Ok(())
        }
    }

    fn named(_: &mut App) -> Result<()> {
        Ok(())
    }

    #[test]
    fn a_plugin_is_called_by_its_type_its_function_or_its_name() {
        let mut plugins = Plugins::default();
        plugins.add(Rear).unwrap();
        plugins.add(named).unwrap();
        plugins.add(|_: &mut App| Ok(())).unwrap();
        plugins.add(("pair", |_: &mut App| Ok(()))).unwrap();
        let closure = "a_plugin_is_called_by_its_type_its_function_or_its_name";
        assert_eq!(plugins.iter().map(|p| p.name()).collect::<Vec<_>>(), ["Rear", "named", closure, "pair"]);
        assert!(plugins.add(("named", |_: &mut App| Ok(()))).unwrap_err().to_string().contains("named"));
    }

    /// A plug-in with one setting.
    #[derive(Clone, Debug, Default, serde::Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Snow {
        flakes: u32,
    }

    impl Plugin for Snow {
        fn with_options(&self, options: Options) -> Result<Option<Arc<dyn Plugin>>> {
            let snow: Self = options.read("snow")?;
            if snow.flakes > 100 {
                return Err(Error::usage("flakes", "are too many", "give at most 100"));
            }
            Ok(Some(Arc::new(snow)))
        }

        fn name(&self) -> Cow<'static, str> {
            format!("snow of {}", self.flakes).into()
        }

        fn build(&self, _: &mut App) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_setting_that_a_plugin_has_not_is_refused_and_changes_nothing() {
        let options = |text: &str| Options::new(text.parse().unwrap());
        let mut plugins = Plugins::default();
        plugins.add(Snow { flakes: 3 }).unwrap();
        plugins.add(named).unwrap();
        let names = |plugins: &Plugins| plugins.iter().map(|p| p.name().into_owned()).collect::<Vec<_>>();
        for (plugin, wrong, word) in [
            ("snow of 3", "flaks = 9", "flaks"),
            ("snow of 3", "flakes = 101", "[snow of 3] flakes"),
            ("named", "flakes = 9", "[named]"),
        ] {
            let e = plugins.configure(plugin, options(wrong)).unwrap_err();
            assert!(e.kind as u8 == 2 && e.to_string().contains(word), "{wrong}: {e}");
        }
        assert_eq!(names(&plugins), ["snow of 3", "named"]);
        assert!(!plugins.configure("rain", options("flakes = 9")).unwrap(), "there is no such plug-in");
        assert!(plugins.configure("named", Options::NONE).unwrap());
        assert!(plugins.configure("snow of 3", options("flakes = 9")).unwrap());
        assert_eq!(names(&plugins), ["snow of 9", "named"]);
    }
}
