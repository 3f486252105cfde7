//! What a server reads from the files that its settings name: at its start, and whenever the operator asks for it.

use crate::problem::Problem;
use crate::service::access::Access;
use crate::service::config::Config;
use crate::service::encryption;
use std::sync::Arc;

pub struct Secrets {
    pub access: Access,
    /// `None`: no encryption.
    pub tls: Option<Arc<rustls::ServerConfig>>,
    /// A token that is not in a file.
    pub token: Option<String>,
}

impl Secrets {
    /// Reads them. `token`: one that is not in a file.
    pub fn read(config: &Config, token: Option<String>) -> Result<Secrets, Vec<Problem>> {
        match (Access::read(config, token.clone()), encryption::read(config)) {
            (Ok(access), Ok(tls)) => Ok(Secrets { access, tls, token }),
            (access, tls) => Err(access.err().into_iter().chain(tls.err()).flatten().collect()),
        }
    }
}
