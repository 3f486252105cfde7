//! Whose bytes are in the store, and from whom it takes where they are too many.
//!
//! Each project has an even share of the store, or its own limit if that is less, and so has each caller of its
//! project's. A caller without a project is one of its own. Who has more than its share loses entries, the one that is
//! furthest above it first; who has less loses none, however full the store is.

use crate::access::CallerLimits;
use std::collections::BTreeMap;

/// Who pays for an entry of the store.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Account {
    /// Empty: none.
    pub project: String,
    /// Empty: an earlier server did not write it down.
    pub caller: String,
}

impl Account {
    pub fn new(project: &str, caller: &str) -> Account {
        Account { project: project.to_owned(), caller: caller.to_owned() }
    }

    /// Those that share one part of the store.
    fn unit(&self) -> Account {
        if self.project.is_empty() { self.clone() } else { Account::new(&self.project, "") }
    }

    fn is_known(&self) -> bool {
        !self.caller.is_empty() || !self.project.is_empty()
    }
}

/// The limits of an account: of the caller, and of its project.
pub type Limits<'a> = &'a dyn Fn(&Account) -> [CallerLimits; 2];

/// Bytes by account.
#[derive(Debug, Default)]
pub struct Usage(BTreeMap<Account, u64>);

impl Usage {
    pub fn add(&mut self, account: &Account, bytes: u64) {
        *self.0.entry(account.clone()).or_default() += bytes;
    }

    pub fn remove(&mut self, account: &Account, bytes: u64) {
        if let Some(own) = self.0.get_mut(account) {
            *own = own.saturating_sub(bytes);
        }
        self.0.retain(|_, bytes| *bytes > 0);
    }

    /// Bytes of an account.
    pub fn of(&self, account: &Account) -> u64 {
        self.0.get(account).copied().unwrap_or(0)
    }

    /// Bytes of all accounts of a project.
    pub fn of_project(&self, project: &str) -> u64 {
        self.0.iter().filter(|(account, _)| account.project == project).map(|(_, bytes)| bytes).sum()
    }

    /// The account that is furthest above its share of so many bytes, of those that have something to lose.
    pub fn furthest_over(&self, most: u64, limits: Limits, has_entries: impl Fn(&Account) -> bool) -> Option<Account> {
        let mut units: BTreeMap<Account, u64> = BTreeMap::new();
        for (account, bytes) in &self.0 {
            *units.entry(account.unit()).or_default() += bytes;
        }
        let own = |limit: Option<u64>, share: u64| limit.map_or(share, |limit| limit.min(share));
        let known = units.keys().filter(|unit| unit.is_known()).count().max(1) as u64;
        let share_of = |unit: &Account| {
            let [caller, project] = limits(unit);
            match unit.is_known() {
                true => own(if unit.project.is_empty() { caller.bytes } else { project.bytes }, most / known),
                false => 0,
            }
        };
        let mut over: Vec<(u64, &Account)> = units
            .iter()
            .filter_map(|(unit, bytes)| Some((bytes.checked_sub(share_of(unit))?, unit)))
            .filter(|(above, _)| *above > 0)
            .collect();
        over.sort_by(|a, b| b.cmp(a));
        // Within a project, the same again.
        over.into_iter().find_map(|(_, unit)| {
            let members: Vec<(&Account, u64)> =
                self.0.iter().filter(|(account, _)| account.unit() == *unit).map(|(a, bytes)| (a, *bytes)).collect();
            let share = share_of(unit) / members.len().max(1) as u64;
            let above = |(account, bytes): (&Account, u64)| {
                let above = bytes.checked_sub(own(limits(account)[0].bytes, share)).filter(|above| *above > 0)?;
                has_entries(account).then(|| (above, account.clone()))
            };
            members.into_iter().filter_map(above).max().map(|(_, account)| account)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usage(rows: &[(&str, &str, u64)]) -> Usage {
        let mut usage = Usage::default();
        rows.iter().for_each(|&(project, caller, bytes)| usage.add(&Account::new(project, caller), bytes));
        usage
    }

    fn first(usage: &Usage, most: u64, limits: &[(&str, u64)]) -> Option<String> {
        let of = |name: &str| {
            let bytes = limits.iter().find(|(known, _)| *known == name).map(|(_, bytes)| *bytes);
            CallerLimits { bytes, ..CallerLimits::default() }
        };
        let limits = |account: &Account| [of(&account.caller), of(&account.project)];
        usage.furthest_over(most, &limits, |_| true).map(|account| account.caller)
    }

    #[test]
    fn who_is_over_its_share_loses() {
        // Anna floods a store of 100, Bob has little.
        assert_eq!(first(&usage(&[("", "anna", 101), ("", "bob", 5)]), 100, &[]).as_deref(), Some("anna"));
        // By her limit, she is over it long before.
        assert_eq!(first(&usage(&[("", "anna", 45), ("", "bob", 49)]), 100, &[("anna", 20)]).as_deref(), Some("anna"));
        assert_eq!(first(&usage(&[("", "anna", 45), ("", "bob", 50)]), 100, &[]), None, "both have their share");
        // One alone may have all.
        assert_eq!(first(&usage(&[("", "anna", 100)]), 100, &[]), None);
        // What nobody owns goes first.
        assert_eq!(first(&usage(&[("", "", 10), ("", "anna", 95)]), 100, &[]).as_deref(), Some(""));
    }

    #[test]
    fn a_project_is_one_and_its_members_share() {
        let rows = [("dune", "anna", 40), ("dune", "ben", 30), ("heat", "cleo", 45)];
        assert_eq!(first(&usage(&rows), 100, &[]).as_deref(), Some("anna"));
        assert_eq!(first(&usage(&rows), 100, &[("heat", 10)]).as_deref(), Some("cleo"));
        assert_eq!(first(&usage(&rows), 100, &[("ben", 5)]).as_deref(), Some("ben"));
    }

    #[test]
    fn who_has_nothing_to_lose_is_passed_over() {
        let usage = usage(&[("", "anna", 90), ("", "bob", 60)]);
        let none = |_: &Account| [CallerLimits::default(); 2];
        let found = usage.furthest_over(100, &none, |account| account.caller != "anna");
        assert_eq!(found, Some(Account::new("", "bob")));
        assert_eq!(usage.furthest_over(100, &none, |_| false), None);
    }
}
