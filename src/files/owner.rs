//! Owners of files.

use std::path::Path;

/// Whether a file or folder belongs to a user who may not speak for whoever runs the program: neither that user nor root, nor the
/// one who called `sudo`. False if the system has no such owners, and where the file cannot be looked at.
pub fn is_foreign(path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        std::fs::metadata(path).is_ok_and(|data| is_foreign_user(data.uid()))
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        false
    }
}

/// Whether a user is neither the one who runs the program, nor root, nor the caller of `sudo`.
#[cfg(unix)]
pub(super) fn is_foreign_user(user: u32) -> bool {
    let own = own_user();
    // Only sudo sets the variable for root; others could say anything.
    let caller = std::env::var("SUDO_UID").ok().filter(|_| own == 0).and_then(|id| id.parse().ok());
    user != own && user != 0 && caller != Some(user)
}

/// The user whose rights the program has.
#[cfg(unix)]
pub(super) fn own_user() -> u32 {
    // SAFETY: the call has no arguments and cannot fail.
    unsafe { libc::geteuid() }
}
