//! Credentials, certificates and keys from the files of the settings, read at the start and again on SIGHUP.

use crate::problem::Problem;
use crate::service::access::Access;
use crate::service::config::Config;
use crate::service::encryption;
use std::sync::Arc;

pub struct Secrets {
    pub access: Access,
    /// `None`: no encryption.
    pub tls: Option<Arc<rustls::ServerConfig>>,
    /// The token where the settings name no file for it.
    pub token: Option<String>,
}

impl Secrets {
    pub fn read(config: &Config, token: Option<String>) -> Result<Secrets, Vec<Problem>> {
        match (Access::read(config, token.clone()), encryption::read(config)) {
            (Ok(access), Ok(tls)) => Ok(Secrets { access, tls, token }),
            (access, tls) => Err(access.err().into_iter().chain(tls.err()).flatten().collect()),
        }
    }
}
