//! Steps of the graph that can be switched off, to measure what each one gains or to narrow down a fault.

use super::access::Queue;

/// Which steps of the plan are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Switches {
    /// Run on one queue, and let each pass wait until everything before it is done.
    pub serial: bool,
    /// Cull passes that nothing needs.
    pub cull: bool,
    /// Let transients alias.
    pub alias: bool,
    /// Run passes on the queues that they request.
    pub asynchronous: bool,
    /// Let the plan reorder passes.
    pub reorder: bool,
    /// Reuse the plan of an earlier, equal declaration.
    pub cache: bool,
    /// Plan for this number of queues (1 to 3), whatever the device has. Batches of missing queues are submitted to its graphics
    /// queue, in an order that cannot deadlock. `None` plans for the device's queues.
    pub queues: Option<u8>,
}

impl Default for Switches {
    fn default() -> Self {
        Self { serial: false, cull: true, alias: true, asynchronous: true, reorder: true, cache: true, queues: None }
    }
}

impl Switches {
    /// The words that `--graph` takes.
    pub const WORDS: [&str; 6] = ["serial", "no-cull", "no-alias", "no-async", "no-reorder", "no-cache"];

    /// Applies one of [`Switches::WORDS`], or `queues=N` with N from 1 to 3. Returns false for any other word.
    pub fn set(&mut self, word: &str) -> bool {
        match word {
            "serial" => self.serial = true,
            "no-cull" => self.cull = false,
            "no-alias" => self.alias = false,
            "no-async" => self.asynchronous = false,
            "no-reorder" => self.reorder = false,
            "no-cache" => self.cache = false,
            _ => match word.strip_prefix("queues=").and_then(|n| n.parse().ok()) {
                Some(count @ 1..=3) => self.queues = Some(count),
                _ => return false,
            },
        }
        true
    }

    /// One of the 64 combinations of [`Switches::WORDS`]: bit i of `bits` applies word i.
    pub fn combination(bits: u8) -> Self {
        let mut switches = Self::default();
        for (_, word) in Self::WORDS.iter().enumerate().filter(|(i, _)| bits >> i & 1 == 1) {
            switches.set(word);
        }
        switches
    }

    /// The queues to plan for, given those of the device.
    pub(crate) fn queues(&self, device: Queues) -> Queues {
        let wanted = match self.queues {
            None => device,
            Some(count) => Queues { async_compute: count >= 2, transfer: count >= 3 },
        };
        if self.serial || !self.asynchronous { Queues::default() } else { wanted }
    }
}

/// Which queues exist beside the graphics queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Queues {
    /// A separate queue for compute.
    pub async_compute: bool,
    /// A separate queue for copies.
    pub transfer: bool,
}

impl Queues {
    /// Number of queues, with the graphics queue.
    pub fn count(self) -> usize {
        1 + usize::from(self.async_compute) + usize::from(self.transfer)
    }

    /// Whether this queue exists; the graphics queue always does.
    pub fn has(self, queue: Queue) -> bool {
        match queue {
            Queue::Graphics => true,
            Queue::AsyncCompute => self.async_compute,
            Queue::Transfer => self.transfer,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_combination_is_another() {
        let all: std::collections::HashSet<Switches> = (0..64).map(Switches::combination).collect();
        assert_eq!(all.len(), 64);
        assert!(all.contains(&Switches::default()));
    }

    #[test]
    fn words_that_are_none_change_nothing() {
        let mut switches = Switches::default();
        for word in ["", "cull", "queues=0", "queues=4", "queues=", "queues=two", "SERIAL"] {
            assert!(!switches.set(word), "{word}");
        }
        assert_eq!(switches, Switches::default());
        assert!(switches.set("queues=3"));
        assert_eq!(switches.queues(Queues::default()).count(), 3);
        assert!(switches.set("serial"));
        assert_eq!(switches.queues(Queues::default()).count(), 1);
    }
}
