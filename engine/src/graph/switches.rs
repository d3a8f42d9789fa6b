//! What the graph can leave undone, so that what each step gives can be measured, and a fault be narrowed down.

use super::access::Queue;

/// Which steps of the plan are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Switches {
    /// Each pass waits until everything before it is done, on one queue.
    pub serial: bool,
    /// Passes that nothing needs are left out.
    pub cull: bool,
    /// Transients share memory.
    pub alias: bool,
    /// Passes run beside each other on the queues they wish for.
    pub asynchronous: bool,
    /// Passes run in an order of the plan's choice.
    pub reorder: bool,
    /// A declaration equal to an earlier one takes its plan.
    pub cache: bool,
    /// Plan for so many queues (1 to 3), whatever the device has: batches of queues that it lacks go to its graphics queue, in an
    /// order that cannot deadlock. `None`: for those it has.
    pub queues: Option<u8>,
}

impl Default for Switches {
    fn default() -> Self {
        Self { serial: false, cull: true, alias: true, asynchronous: true, reorder: true, cache: true, queues: None }
    }
}

impl Switches {
    /// The words of `--graph`.
    pub const WORDS: [&str; 6] = ["serial", "no-cull", "no-alias", "no-async", "no-reorder", "no-cache"];

    /// Sets one of [`Switches::WORDS`], or `queues=N` with N from 1 to 3; false where the word is none of them.
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

    /// One of the 64 combinations of [`Switches::WORDS`], by its bits.
    pub fn combination(bits: u8) -> Self {
        let mut switches = Self::default();
        for (_, word) in Self::WORDS.iter().enumerate().filter(|(i, _)| bits >> i & 1 == 1) {
            switches.set(word);
        }
        switches
    }

    /// The queues to plan for, on a device that has these.
    pub(crate) fn queues(&self, device: Queues) -> Queues {
        let wanted = match self.queues {
            None => device,
            Some(count) => Queues { async_compute: count >= 2, transfer: count >= 3 },
        };
        if self.serial || !self.asynchronous { Queues::default() } else { wanted }
    }
}

/// Which queues there are beside the one for graphics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Queues {
    /// One for compute.
    pub async_compute: bool,
    /// One for copies.
    pub transfer: bool,
}

impl Queues {
    /// How many, with the one for graphics.
    pub fn count(self) -> usize {
        1 + usize::from(self.async_compute) + usize::from(self.transfer)
    }

    /// Whether there is such a queue.
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
