//! Panics of winit as failures. Most of its calls return no error: where the display is lost, they panic.

use std::{
    cell::Cell,
    panic::{self, AssertUnwindSafe, PanicHookInfo},
    path::Path,
    sync::Once,
};

use crate::exit::Failure;

thread_local! {
    /// Whether the last panic of this thread came from winit's own source.
    static IS_OF_WINIT: Cell<bool> = const { Cell::new(false) };
}

static HOOK: Once = Once::new();

/// Does `work`. A panic of winit within it is a [`Failure::Run`], and prints nothing; any other panic goes on.
pub(super) fn guarded<T>(work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    HOOK.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            let is_of_winit = is_of_winit(info);
            IS_OF_WINIT.set(is_of_winit);
            if !is_of_winit {
                before(info);
            }
        }));
    });
    // What the panic has left half done is only dropped.
    panic::catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        if !IS_OF_WINIT.get() {
            panic::resume_unwind(payload);
        }
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let reason = text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("it gives no reason");
        Err(Failure::Run(anyhow::anyhow!("the window system does not answer ({reason})")))
    })
}

fn is_of_winit(info: &PanicHookInfo<'_>) -> bool {
    let file = info.location().map_or("", |location| location.file());
    Path::new(file).components().any(|part| part.as_os_str().to_string_lossy().starts_with("winit"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use winit::event_loop::EventLoop;

    /// An event loop beside the main thread is one of the things that winit panics of.
    #[test]
    fn a_panic_of_winit_is_a_failure() {
        let made = std::thread::spawn(|| guarded(|| EventLoop::new().map_err(Failure::running).map(|_| ())));
        let failure = made.join().unwrap().unwrap_err();
        assert_eq!(failure.status(), 1);
        assert!(failure.message().contains("outside of the main thread"), "{}", failure.message());
    }

    #[test]
    fn any_other_panic_goes_on() {
        let other = std::thread::spawn(|| guarded::<()>(|| panic!("ours")));
        let payload = other.join().unwrap_err();
        assert_eq!(payload.downcast_ref::<&str>(), Some(&"ours"));
        assert_eq!(guarded(|| Ok(3)).ok(), Some(3));
    }
}
