//! Errors of the kernels.

/// Why a kernel gives no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument is outside what the function accepts.
    #[error("{name}: {reason}")]
    InvalidArgument {
        /// The argument's name.
        name: &'static str,
        /// The fault, and the accepted values.
        reason: String,
    },
    /// The arguments are well formed, but the data cannot support an answer.
    #[error("{name}: {reason}")]
    NotEnoughData {
        /// The argument that holds too little.
        name: &'static str,
        /// The data that are missing.
        reason: String,
    },
}

impl Error {
    pub(crate) fn invalid(name: &'static str, reason: impl Into<String>) -> Self {
        Self::InvalidArgument { name, reason: reason.into() }
    }

    pub(crate) fn not_enough(name: &'static str, reason: impl Into<String>) -> Self {
        Self::NotEnoughData { name, reason: reason.into() }
    }
}

/// The result of a kernel.
pub type Result<T> = std::result::Result<T, Error>;
