//! What `--version` says.

use std::sync::LazyLock;

/// Version, commit and features, a line each.
pub static LONG: LazyLock<String> = LazyLock::new(|| {
    let features = [
        ("cli", cfg!(feature = "cli")),
        ("formats", cfg!(feature = "formats")),
        ("gpu", cfg!(feature = "gpu")),
        ("chart", cfg!(feature = "chart")),
    ];
    let on: Vec<&str> = features.iter().filter(|(_, is_on)| *is_on).map(|(name, _)| *name).collect();
    let [version, commit] = [env!("CARGO_PKG_VERSION"), env!("BULBFOLD_COMMIT")];
    let (arch, os) = (std::env::consts::ARCH, std::env::consts::OS);
    format!(
        "{version}\ncommit    {commit}\nfeatures  {}\nmachine   {arch}, {os}\nlicence   MIT OR Apache-2.0",
        on.join(", ")
    )
});
