#![allow(missing_docs, dead_code)]
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
pub const N: usize = 24;
pub static NS: [AtomicU64; N] = [const { AtomicU64::new(0) }; N];
pub static COUNT: [AtomicU64; N] = [const { AtomicU64::new(0) }; N];
pub fn t<T>(i: usize, f: impl FnOnce() -> T) -> T {
    let s = Instant::now();
    let r = f();
    NS[i].fetch_add(s.elapsed().as_nanos() as u64, Ordering::Relaxed);
    COUNT[i].fetch_add(1, Ordering::Relaxed);
    r
}
pub fn print() {
    const NAMES: [&str; N] = ["storage", "bind", "submit", "poll", "read copy", "upload", "measured", "staging", "first_pass parts", "first_pass set", "bytes", "second list", "second parts", "set_pixels", "forget", "only parts", "starts", "columns", "run", "download", "writebuf", "pixels+rows", "stats.count", "encode"];
    for i in 0..N {
        eprintln!("  {:18} {:8.2} ms {:6}", NAMES[i], NS[i].load(Ordering::Relaxed) as f64 / 1e6, COUNT[i].load(Ordering::Relaxed));
    }
}
