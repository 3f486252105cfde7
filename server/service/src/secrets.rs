//! Credentials, certificates and keys from the files of the settings, read at the start and again on SIGHUP.

use crate::access::Access;
use crate::config::Config;
use crate::encryption;
use crate::hook::Hook;
use cairn_files::problem::Problem;
use std::sync::Arc;

pub struct Secrets {
    pub access: Access,
    /// `None`: no encryption.
    pub tls: Option<Arc<rustls::ServerConfig>>,
    /// The token where the settings name no file for it.
    pub token: Option<String>,
    pub hook: Option<Hook>,
}

impl Secrets {
    pub fn read(config: &Config, token: Option<String>) -> Result<Secrets, Vec<Problem>> {
        match (Access::read(config, token.clone()), encryption::read(config), Hook::read(config)) {
            (Ok(access), Ok(tls), Ok(hook)) => Ok(Secrets { access, tls, token, hook }),
            (access, tls, hook) => Err(access.err().into_iter().chain(tls.err()).chain(hook.err()).flatten().collect()),
        }
    }
}
